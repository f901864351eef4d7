"""Commands that measure what settings cost and what they are worth; :mod:`sandbox.cli` gives them their names."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sandbox.cli_options import (
    JsonOption,
    SceneArgument,
    SetOption,
    WithOption,
    contents,
    load,
    names,
    naming,
    numbers,
    part_of_one,
    quantity,
)
from sandbox.errors import SandboxError, SceneError
from sandbox.scene.model import IntegratorName, Precision

SchemesOption = Annotated[str | None, typer.Option(metavar="NAME,NAME", help="Integrators to look at; all by default.")]
IterationsOption = Annotated[
    str | None, typer.Option(metavar="N,N", help="Iterations of xpbd and sweeps of vbd a step.")
]
HorizonOption = Annotated[
    float | None, typer.Option(help="Time that is looked at [s]; by default 1 s, or less where the scene is heavy.")
]
WorkersOption = Annotated[
    int | None, typer.Option(help="Processes for runs side by side; all cores by default. Timings run alone.")
]
ClusterOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler whose workers do the runs.")
]
OutOption = Annotated[Path | None, typer.Option(help="Folder; outputs/NAME-trade by default.")]
ArchOption = Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")]
ThreadsOption = Annotated[int | None, typer.Option(help="CPU threads of timed runs; all cores by default.")]
FreshOption = Annotated[bool, typer.Option("--fresh", help="Forget the finished rows of an interrupted study.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing but the table, or errors.")]


def measure(
    scene: SceneArgument,
    set_: SetOption = None,
    with_: WithOption = None,
    schemes: SchemesOption = None,
    dts: Annotated[
        str | None, typer.Option(metavar="DT,DT", help="Steps of every integrator [s]; by default what fits each.")
    ] = None,
    iterations: IterationsOption = None,
    precisions: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="f32, f64; by default the scene's, and a few in f64.")
    ] = None,
    horizon: HorizonOption = None,
    model: Annotated[
        bool, typer.Option("--model", help="Instead: what each part of the scene costs, and the error without it.")
    ] = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    out: OutOption = None,
    arch: ArchOption = "cpu",
    threads: ThreadsOption = None,
    fresh: FreshOption = False,
    quiet: QuietOption = False,
    json_: JsonOption = False,
) -> None:
    """The trade of a scene: error and wall time of every integrator at several steps, as table, CSV, JSON and plot."""
    loaded = load(scene, set_, fragments=with_)
    from sandbox.trade import results
    from sandbox.trade.ladder import Choice

    choice = Choice(
        schemes=names("--schemes", schemes, IntegratorName) or tuple(IntegratorName),
        dts=numbers("--dts", dts, float),
        iterations=numbers("--iterations", iterations, int),
        precisions=names("--precisions", precisions, Precision),
    )
    options = study_options(choice, horizon, workers, cluster, arch, threads)
    if model:
        if any((schemes, dts, iterations, precisions)):
            raise SceneError("--model: looks at the scene's own settings; change them with --set solver...")
        _measure_models(scene, loaded, options, out, fresh, quiet, json_)
        return
    with _named(scene, out or Path("outputs") / f"{Path(scene).stem}-trade"):
        trade, folder = results.report_trade(loaded, Path(scene).stem, options, out, fresh, silent=quiet or json_)
    _warn(trade.unseen)
    if json_:
        typer.echo((folder / "trade.json").read_text(encoding="utf-8"), nl=False)
        return
    typer.echo(results.summary(trade))
    print_table(results.COLUMNS, results.table(trade.rows))
    typer.echo(f"{folder}: {contents(folder)}")


def _measure_models(
    scene: str, loaded: Any, options: Any, out: Path | None, fresh: bool, quiet: bool, json_: bool
) -> None:
    from sandbox.trade import models, results

    with _named(scene, out or Path("outputs") / f"{Path(scene).stem}-models"):
        trade, folder = results.report_models(loaded, Path(scene).stem, options, out, fresh, silent=quiet or json_)
    _warn(trade.unseen)
    if json_:
        typer.echo((folder / "models.json").read_text(encoding="utf-8"), nl=False)
        return
    typer.echo(results.summary(trade))
    print_table(models.COLUMNS, models.table(trade))
    for line in trade.left_out:
        typer.echo(line)
    typer.echo(f"{folder}: {contents(folder)}")


def tune(
    scene: SceneArgument,
    set_: SetOption = None,
    with_: WithOption = None,
    error: Annotated[
        str | None, typer.Option(metavar="1%", help="Find the cheapest settings within this position error.")
    ] = None,
    budget: Annotated[
        str | None, typer.Option(metavar="16ms", help="Find the most accurate settings within this time a picture.")
    ] = None,
    write: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the settings there, as TOML.")] = None,
    schemes: SchemesOption = None,
    iterations: IterationsOption = None,
    horizon: HorizonOption = None,
    workers: WorkersOption = None,
    cluster: ClusterOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder; outputs/NAME-tune by default.")] = None,
    arch: ArchOption = "cpu",
    threads: ThreadsOption = None,
    fresh: FreshOption = False,
    quiet: QuietOption = False,
    json_: JsonOption = False,
) -> None:
    """The cheapest settings within an error, or the most accurate within a frame's time, as TOML that --with takes."""
    if (error is None) == (budget is None):
        raise SceneError("tune: give either --error, such as 1%, or --budget, such as 16ms")
    loaded = load(scene, set_, fragments=with_)
    from sandbox.files import replace_when_whole
    from sandbox.trade import results
    from sandbox.trade.ladder import Choice
    from sandbox.trade.tune import Target

    target = Target(part_of_one("--error", error), quantity("--budget", budget, {"ms": 1e-3, "s": 1.0, "us": 1e-6}))
    choice = Choice(
        schemes=names("--schemes", schemes, IntegratorName) or tuple(IntegratorName),
        iterations=numbers("--iterations", iterations, int),
    )
    options = study_options(choice, horizon, workers, cluster, arch, threads)
    name = Path(scene).stem
    with _named(scene, out or Path("outputs") / f"{name}-tune"):
        tuned, looked, folder = results.report_tuned(loaded, name, options, out, fresh, quiet or json_, target)
    _warn(tuned.unseen)
    fragment = results.tuned_fragment(target, tuned, looked)
    if write is not None:
        try:
            with replace_when_whole(write) as temporary:
                temporary.write_text(fragment, encoding="utf-8")
        except OSError as trouble:
            raise SceneError(f"--write {write}: cannot be written: {trouble.strerror or trouble}") from None
    typer.echo((folder / "tune.json").read_text(encoding="utf-8") if json_ else fragment, nl=False)


def _warn(lines: Sequence[str]) -> None:
    """What a study did not see, a line each on standard error."""
    for line in lines:
        typer.echo(f"warning: {line}", err=True)


def study_options(
    choice: Any, horizon: float | None, workers: int | None, cluster: str | None, arch: str, threads: int | None
) -> Any:
    """Options of a study from those of a command. Raises SceneError where one makes no sense."""
    from sandbox import runtime
    from sandbox.trade.measure import Options

    if horizon is not None and not 0.0 < horizon < 1e6:
        raise SceneError(f"--horizon {horizon:g}: must be > 0")
    if workers is not None and not 1 <= workers <= 256:
        raise SceneError(f"--workers {workers}: must be between 1 and 256")
    runtime.check(arch, "f32", threads)
    return Options(choice, horizon, workers or os.cpu_count() or 1, cluster, arch, threads)


@contextlib.contextmanager
def _named(scene: str, folder: Path) -> Iterator[None]:
    """Errors of a study name its scene; an interruption says that it can go on."""
    try:
        with naming(scene):
            yield
    except KeyboardInterrupt:
        raise SandboxError(
            f"interrupted; finished rows are kept in {folder}: the same command goes on from there"
        ) from None


def print_table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """A table on standard output, words to the left and numbers to the right."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for number, column in enumerate(columns):
        # Units in brackets are no markup.
        is_text = number in (0, len(columns) - 1)
        table.add_column(escape(column), justify="left" if is_text else "right", no_wrap=True)
    for row in rows:
        table.add_row(*map(escape, row))
    Console(width=160).print(table)
