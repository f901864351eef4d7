"""The command serve: a live scene in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from sandbox.cli_options import SceneArgument, SetOption, WithOption, load, naming, tell
from sandbox.serve.limits import CLIENTS, in_words


def serve(
    scene: SceneArgument,
    set_: SetOption = None,
    with_: WithOption = None,
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 for all machines.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 for any that is free.")] = 8080,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="SANDBOX_TOKEN",
            help="What browsers must know; made up where other machines reach the address. Better in the environment, "
            "where other users of this machine do not see it.",
        ),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Leave what was done there, for run --actions.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End by itself after so long, in real time [s].")] = None,
    shadows: Annotated[bool, typer.Option(help="Have things throw shadows; dear without a GPU.")] = True,
    pictures: Annotated[float, typer.Option(help="Pictures sent a second; a slow browser gets fewer.")] = 60.0,
    clients: Annotated[int, typer.Option(help="Browsers that may look at once.")] = CLIENTS,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    precision: Annotated[str | None, typer.Option(help="f32 or f64; the scene's by default.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
) -> None:
    """Show a live scene in the browser: drag bodies with the mouse, change material and solver, record."""
    loaded = load(scene, set_, fragments=with_)
    from sandbox.serve.app import ServeOptions
    from sandbox.serve.app import serve as serve_scene

    options = ServeOptions(host, port, token, record, seconds, shadows, arch, precision, threads, pictures, clients)
    with naming(scene):
        end = serve_scene(loaded, options, lambda address: typer.echo(f"open {address} (Ctrl-C ends)"), tell)
    typer.echo(end)


serve.__doc__ = f"{serve.__doc__}\n\n{in_words()}"
