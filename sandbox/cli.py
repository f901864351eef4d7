"""The command line: one thin function a command."""

import json
import signal
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from sandbox import __version__, cli_export, cli_live, cli_serve, cli_studies
from sandbox.cli_options import (
    ActionsOption,
    JsonOption,
    SceneArgument,
    SetOption,
    WithOption,
    act_on,
    contents,
    ending,
    load,
    names,
    naming,
    picture_size,
    scene_data,
    tell,
    told,
)
from sandbox.errors import SandboxError, SceneError, one_line
from sandbox.scene.load import json_schema
from sandbox.scene.model import IntegratorName, Scene

# Typer depends on click in some versions and carries its own copy in others; it exports only this leaf.
_UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    help="A real-time soft-body sandbox: scenes in, videos and numbers out.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # units in brackets are no markup
    context_settings={"max_content_width": 120},
)


@app.callback(invoke_without_command=True)
def main_options(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """A real-time soft-body sandbox: scenes in, videos and numbers out."""
    if version or context.invoked_subcommand is None:
        typer.echo(__version__ if version else context.get_help())
        raise typer.Exit


@app.command()
def run(
    scene: SceneArgument,
    set_: SetOption = None,
    with_: WithOption = None,
    seconds: Annotated[float | None, typer.Option(help="Simulated time at the end [s].")] = None,
    fps: Annotated[float | None, typer.Option(help="Pictures a simulated second.")] = None,
    size: Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Picture size, e.g. 1280x720.")] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; outputs/NAME by default.")] = None,
    renderer: Annotated[str, typer.Option(help="taichi, ggui (the machine's Vulkan driver) or none.")] = "taichi",
    video: Annotated[str, typer.Option(help="mp4, webm, gif, png or none.")] = "mp4",
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    precision: Annotated[str | None, typer.Option(help="f32 or f64; the scene's by default.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR", help="Go on from a checkpoint, or with the run that a folder holds unfinished."
        ),
    ] = None,
    actions: ActionsOption = None,
    trajectory: cli_export.TrajectoryOption = None,
    export: cli_export.ExportOption = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors and warnings.")] = False,
    json_: JsonOption = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show Taichi's own log.")] = False,
) -> None:
    """Simulate a scene, draw it, and leave a run folder with video, poster, metrics and checkpoint."""
    shortcuts = {"duration": seconds, "render.fps": fps, "render.size": None if size is None else picture_size(size)}
    loaded = load(scene, set_, shortcuts, with_)
    tick = None
    if actions is not None:
        loaded, header = act_on(loaded, actions, seconds)
        if header is not None:
            precision, tick = precision or str(header.precision), header.tick
    from sandbox.headless import RunOptions
    from sandbox.headless import run as run_scene

    name = Path(scene).stem
    options = RunOptions(
        name,
        out,
        renderer,
        video,
        arch,
        precision,
        threads,
        resume,
        verbose,
        tick,
        trajectory,
        cli_export.kinds(export),
    )
    with ending(options.folder), naming(scene), _progress(loaded, quiet or json_) as progress:
        summary = run_scene(loaded, options, progress)
    tell(summary.warnings)
    if json_:
        typer.echo((options.folder / "summary.json").read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        typer.echo(
            f"{summary.folder}: {summary.simulated:g} s in {summary.seconds['total']:.1f} s, "
            f"{summary.real_time_factor:.1f}x real time (simulation), {', '.join(summary.files)}"
        )


@app.command()
def scenes(json_: JsonOption = False) -> None:
    """List the presets: name, title, size, and what physics each uses."""
    from sandbox.catalogue import catalogue

    rows = catalogue()
    if json_:
        typer.echo(json.dumps(rows, indent=2))
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column in ("name", "title", "particles", "springs", "physics"):
        table.add_column(column, justify="right" if column in ("particles", "springs") else "left")
    for row in rows:
        words = (row["name"], row["title"], str(row["particles"]), str(row["springs"]), ", ".join(row["physics"]))
        table.add_row(*map(escape, words))
    Console().print(table)


@app.command()
def stability(
    scene: SceneArgument,
    set_: SetOption = None,
    schemes: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="Integrators to look at; all by default.")
    ] = None,
    horizon: Annotated[float | None, typer.Option(help="Time over which steps must hold [s]; 0.4 by default.")] = None,
    map_: Annotated[
        bool, typer.Option("--map", help="Also the map over stiffness, damping, mass ratio and dt, of the scene's own.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder; outputs/NAME-stability by default.")] = None,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but the table, or errors.")] = False,
    json_: JsonOption = False,
) -> None:
    """Largest stable dt of every scheme for a scene: predicted, and measured by bisection."""
    if horizon is not None and not horizon > 0.0:
        raise SceneError(f"--horizon {horizon:g}: must be > 0")
    loaded = load(scene, set_)
    from sandbox.trade.report import StabilityOptions, report_stability

    options = StabilityOptions(
        name=Path(scene).stem,
        schemes=names("--schemes", schemes, IntegratorName) or tuple(IntegratorName),
        horizon=horizon,
        draws_map=map_,
        out=out,
        arch=arch,
        threads=threads,
    )
    try:
        rows, folder = report_stability(loaded, options, silent=quiet or json_)
    except SceneError as error:
        raise SceneError(f"{scene}: {error}") from None
    if json_:
        typer.echo((folder / "stability.json").read_text(encoding="utf-8"), nl=False)
        return
    _print_stable_steps(rows)
    typer.echo(f"{folder}: {contents(folder)}")


def _print_stable_steps(rows: Any) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column in ("integrator", "order", "predicted [s]", "measured [s]", "measured/predicted", "held for [s]"):
        table.add_column(escape(column), justify="left" if column == "integrator" else "right")
    for row in rows:
        table.add_row(
            row.scheme,
            str(row.order),
            "none" if row.predicted is None else f"{row.predicted:.4g}",
            f"> {row.tried:.3g}" if row.measured is None else f"{row.measured:.4g}",
            "" if row.ratio is None else f"{row.ratio:.3f}",
            f"{row.horizon:.3g}",
        )
    Console(width=100).print(table)


app.command()(cli_studies.measure)
app.command()(cli_studies.tune)
app.command()(cli_export.export)
app.command()(cli_export.render)
app.command()(cli_live.play)
app.command()(cli_serve.serve)


@app.command()
def sweep(
    scene: SceneArgument,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=A,B", help="Values that a key takes in turn, e.g. solver.dt=1e-4,1e-3."),
    ] = None,
    set_: SetOption = None,
    with_: WithOption = None,
    seconds: Annotated[float | None, typer.Option(help="Simulated time at the end [s].")] = None,
    fps: Annotated[float | None, typer.Option(help="Pictures a simulated second.")] = None,
    size: Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Picture size, e.g. 1280x720.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; outputs/NAME-sweep by default.")] = None,
    video: Annotated[str, typer.Option(help="Of every run: mp4, webm, gif, png or none.")] = "none",
    posters: Annotated[bool, typer.Option("--posters", help="Draw a poster of every run, and a sheet of all.")] = False,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    precision: Annotated[str | None, typer.Option(help="f32 or f64; the scene's by default.")] = None,
    threads: Annotated[
        int | None, typer.Option(help="CPU threads of a run; by default 1 where several are side by side.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes for runs side by side; all cores by default.")] = None,
    cluster: cli_studies.ClusterOption = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run again what an earlier sweep finished.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but the table, or errors.")] = False,
    json_: JsonOption = False,
) -> None:
    """Every combination of values: a run folder each, and one table."""
    if workers is not None and not 1 <= workers <= 256:
        raise SceneError(f"--workers {workers}: must be between 1 and 256")
    shortcuts = {"duration": seconds, "render.fps": fps, "render.size": None if size is None else picture_size(size)}
    base = scene_data(scene, set_, shortcuts, with_)
    from sandbox.trade import sweep as sweeping
    from sandbox.trade.combinations import SceneData, parse_variation
    from sandbox.trade.sweep_table import table

    variations = [parse_variation(text) for text in vary or []]
    options = sweeping.SweepOptions(
        Path(scene).stem, out, video, posters, arch, precision, threads, workers, cluster, fresh
    )
    rows, folder = sweeping.sweep(SceneData(*base), variations, options, silent=quiet or json_)
    failed = [row for row in rows if row.status in ("crashed", "refused")]
    if json_:
        typer.echo((folder / "sweep.json").read_text(encoding="utf-8"), nl=False)
    else:
        cli_studies.print_table(*table(variations, rows))
        typer.echo(f"{folder}: {len(rows)} runs, {', '.join(sorted(path.name for path in folder.glob('sweep.*')))}")
    for row in failed:
        typer.echo(f"{row.label}: {row.status}: {row.message}", err=True)
    if any(row.status == "crashed" for row in rows):
        raise typer.Exit(1)


@app.command()
def validate(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A scene file, or a preset's name.")],
    set_: SetOption = None,
    with_: WithOption = None,
    actions: ActionsOption = None,
) -> None:
    """Check a scene file, and what is done to it; say in one line what is wrong, and of what one should be warned."""
    loaded = load(file, set_, fragments=with_)
    if actions is not None:
        loaded, _ = act_on(loaded, actions, None)
    from sandbox.scene.assemble import assemble

    try:
        assembly = assemble(loaded)
        remarks = _remarks(assembly)
    except SceneError as error:
        raise SceneError(f"{file}: {error}") from None
    tell(remark.line for remark in remarks)
    typer.echo(f"{file}: ok, {assembly.particle_count} particles, {assembly.spring_count} springs")


def _remarks(assembly: Any) -> list[Any]:
    """What a run would warn of before its first step. Raises SceneError where it would not begin."""
    from sandbox.integrators.schemes import SCHEMES
    from sandbox.pipeline import network_of
    from sandbox.recording import late_actions
    from sandbox.start import check_start, start_remarks
    from sandbox.step_size import StepSize

    solver = assembly.scene.solver
    check_start(assembly, str(solver.precision))
    steps = StepSize(SCHEMES[solver.integrator], assembly, network_of(assembly.unheld()))
    return [*steps.remarks(), *start_remarks(assembly), *late_actions(assembly.scene)]


@app.command()
def schema() -> None:
    """Print the JSON Schema of scene files."""
    typer.echo(json_schema())


def _progress(scene: Scene, silent: bool) -> Any:
    if silent:
        import contextlib

        from sandbox.output.progress import NoProgress

        return contextlib.nullcontext(NoProgress())
    from sandbox.output.progress import ProgressBar

    return ProgressBar(scene.title or "simulating", scene.duration)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    tell([str(message)])


def main() -> None:
    """Entry point: every error that a user can make is one line and exit code 2."""
    warnings.showwarning = _show_warning
    told.clear()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = app(standalone_mode=False)
    except _UsageError as error:
        code = _fail(error.format_message(), 2)
    except SandboxError as error:
        code = _fail(str(error), error.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        code = _fail("interrupted", 1)
    except MemoryError:
        code = _fail("out of memory: the scene is too large for this machine", 1)
    except BrokenPipeError:
        code = 1
    sys.exit(code or 0)


def _fail(message: str, code: int) -> int:
    print(f"sandbox: {one_line(message)}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
