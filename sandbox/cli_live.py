"""Commands that show a scene while it runs, and let it be touched."""

from pathlib import Path
from typing import Annotated

import typer

from sandbox.cli_options import SceneArgument, SetOption, WithOption, load, naming, picture_size
from sandbox.errors import SceneError


def play(
    scene: SceneArgument,
    set_: SetOption = None,
    with_: WithOption = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write what was done, for `run SCENE --actions FILE`.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End by itself after so long, in real time [s].")] = None,
    size: Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Of the window, e.g. 1280x720.")] = None,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    precision: Annotated[str | None, typer.Option(help="f32 or f64; the scene's by default.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """A live window: the mouse grabs. Needs a screen and a Vulkan driver."""
    if seconds is not None and not 0.0 < seconds < 1e9:
        raise SceneError(f"--seconds {seconds:g}: must be > 0")
    if record is not None and not (record.parent.is_dir() and not record.is_dir()):
        raise SceneError(f"--record {record}: no such folder, or a folder itself")
    loaded = load(scene, set_, {"render.size": None if size is None else picture_size(size)}, with_)
    from sandbox.live.play import PlayOptions
    from sandbox.live.play import play as play_scene

    options = PlayOptions(f"sandbox: {loaded.title or Path(scene).stem}", record, seconds, arch, precision, threads)
    with naming(scene):
        summary = play_scene(loaded, options)
    if not quiet:
        kept = f"; {record} holds what was done" if record is not None else ""
        typer.echo(
            f"{scene}: {summary.simulated:.4g} s in {summary.ticks} ticks, {summary.actions} actions, "
            f"state {summary.state_sha256[:16]}{kept}"
        )
