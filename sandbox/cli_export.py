"""Commands that write runs for other programs, and draw stored ones anew; :mod:`sandbox.cli` gives them their names."""

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

from sandbox.cli_options import SetOption, WithOption, ending, load, picture_size, tell
from sandbox.errors import SandboxError, SceneError
from sandbox.scene.load import preset_paths
from sandbox.scene.model import Scene
from sandbox.scene.overrides import parse_assignment

RunArgument = Annotated[str, typer.Argument(metavar="RUNFOLDER", help="A run folder with a trajectory, or that file.")]
TrajectoryOption = Annotated[
    str | None, typer.Option(metavar="KIND", help="Also write the state at every picture: npz or zarr.")
]
ExportOption = Annotated[
    str | None,
    typer.Option(metavar="KIND,KIND", help="Also write mesh files: ply, faces, obj, vtu, springs, usd, glb."),
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors and warnings.")]
SizeOption = Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Picture size, e.g. 1280x720.")]
_CAMERA = ("eye", "target", "field_of_view", "height")


def export(
    source: Annotated[str, typer.Argument(metavar="SCENE_OR_RUNFOLDER", help="A scene, or a run with a trajectory.")],
    format_: Annotated[
        str, typer.Option("--format", metavar="KIND,KIND", help="Mesh files: ply, faces, obj, vtu, springs, usd, glb.")
    ] = "vtu",
    set_: SetOption = None,
    with_: WithOption = None,
    seconds: Annotated[float | None, typer.Option(help="Simulated time at the end [s], of a scene.")] = None,
    fps: Annotated[float | None, typer.Option(help="Files a simulated second.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; outputs/NAME-export by default, or the run folder itself.")
    ] = None,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    precision: Annotated[str | None, typer.Option(help="f32 or f64; the scene's by default.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Write every picture's surfaces as mesh files: of a scene by simulating it, of a stored run without."""
    from sandbox.exports import check_formats

    formats = check_formats("--format", kinds(format_))
    if not _is_stored(source):
        shortcuts = {"duration": seconds, "render.fps": fps}
        loaded = load(source, set_, shortcuts, with_)
        _export_scene(source, loaded, formats, out, (arch, precision, threads), quiet)
        return
    for option, value in (("--seconds", seconds), ("--precision", precision), ("--with", with_)):
        if value is not None:
            raise SceneError(f"{option}: a stored run is not simulated again; export the scene instead")
    from sandbox.output.trajectory import Trajectory
    from sandbox.rerender import changed_scene, export_stored

    with Trajectory.open(source) as trajectory:
        scene = changed_scene(trajectory, *_looks(set_, {"render.fps": ("--fps", fps)}))
        folder = out or trajectory.path.parent
        with _progress(scene, quiet) as progress:
            names = export_stored(trajectory, scene, formats, folder, progress)
    if not quiet:
        typer.echo(f"{folder}: {', '.join(names)}")


def _export_scene(
    source: str, scene: Scene, formats: tuple[str, ...], out: Path | None, machine: tuple[Any, ...], quiet: bool
) -> None:
    from sandbox.headless import RunOptions, run

    name = Path(source).stem
    arch, precision, threads = machine
    folder = out or Path("outputs") / f"{name}-export"
    options = RunOptions(name, folder, "none", "none", arch, precision, threads, exports=tuple(formats))
    with ending(folder), _progress(scene, quiet) as progress:
        summary = run(scene, options, progress)
    tell(summary.warnings)
    if not quiet:
        typer.echo(f"{folder}: {summary.simulated:g} s, {', '.join(summary.files)}")


def render(
    run: RunArgument,
    set_: SetOption = None,
    camera: Annotated[
        str | None,
        typer.Option(metavar="'eye=X,Y,Z target=X,Y,Z'", help="Another camera; also field_of_view=, in 2D height=."),
    ] = None,
    size: SizeOption = None,
    fps: Annotated[float | None, typer.Option(help="Pictures a simulated second: those stored, or fewer.")] = None,
    renderer: Annotated[str, typer.Option(help="As run takes it.")] = "taichi",
    video: Annotated[str, typer.Option(help="mp4, webm, gif, png or none.")] = "mp4",
    out: Annotated[Path | None, typer.Option(help="Folder; RUNFOLDER-render by default.")] = None,
    arch: Annotated[str, typer.Option(help="cpu, cuda, vulkan or metal.")] = "cpu",
    threads: Annotated[int | None, typer.Option(help="CPU threads; all cores by default.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Draw a stored run anew from another camera, in other colours or size, without simulating it."""
    given: dict[str, tuple[str, Any]] = {
        "render.size": ("--size", None if size is None else picture_size(size)),
        "render.fps": ("--fps", fps),
    }
    given.update({f"render.camera.{key}": ("--camera", value) for key, value in camera_changes(camera).items()})
    from sandbox.headless import RunOptions, check_options
    from sandbox.output.trajectory import Trajectory
    from sandbox.rerender import RerenderOptions, changed_scene, rerender

    check_options(RunOptions("", renderer=renderer, video=video))
    if renderer == "none":
        raise SceneError("--renderer none: there would be nothing to see")
    with Trajectory.open(run) as trajectory:
        scene = changed_scene(trajectory, *_looks(set_, given))
        folder = trajectory.path.parent
        options = RerenderOptions(
            out or folder.with_name(f"{folder.resolve().name}-render"), renderer, video, arch, threads
        )
        try:
            with _progress(scene, quiet) as progress:
                names = rerender(trajectory, scene, options, progress)
        except KeyboardInterrupt:
            raise SandboxError("interrupted; nothing was written") from None
    if not quiet:
        typer.echo(f"{options.out}: {', '.join(names)}")


def kinds(text: str | None) -> tuple[str, ...]:
    """The names of a list, NAME,NAME."""
    return () if text is None else tuple(name.strip() for name in text.split(","))


def camera_changes(text: str | None) -> dict[str, Any]:
    """``eye=x,y,z target=x,y,z`` as values by key. Raises SceneError where it is none."""
    found: dict[str, Any] = {}
    for part in (text or "").split():
        key, equals, value = part.partition("=")
        try:
            numbers = [float(number) for number in value.split(",")]
        except ValueError:
            numbers = []
        if key not in _CAMERA or not equals or not numbers:
            raise SceneError(f"--camera {part}: must be like eye=1,2,5 target=0,1,0, of {', '.join(_CAMERA)}")
        found[key] = numbers if key in ("eye", "target") else numbers[0]
    return found


def _looks(assignments: list[str] | None, options: dict[str, tuple[str, Any]]) -> tuple[dict[str, Any], dict[str, str]]:
    """Changes by dotted key, and of which option those are that do not come from --set."""
    changes = dict(parse_assignment(text) for text in assignments or [])
    given = {key: (option, value) for key, (option, value) in options.items() if value is not None}
    changes.update({key: value for key, (_, value) in given.items()})
    return changes, {key: option for key, (option, _) in given.items()}


def _is_stored(source: str) -> bool:
    """Whether a name is that of a run folder or a trajectory, not of a scene."""
    path = Path(source)
    return source not in preset_paths() and (path.is_dir() or path.suffix in (".npz", ".zarr"))


def _progress(scene: Scene, silent: bool) -> Any:
    from sandbox.output.progress import NoProgress, ProgressBar

    return contextlib.nullcontext(NoProgress()) if silent else ProgressBar(scene.title or "drawing", scene.duration)
