"""A stored run drawn anew, or written as mesh files, without simulating it again."""

import contextlib
import copy
import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.exports import open_exports
from sandbox.output.folder import RunFolder
from sandbox.output.frames import Frame
from sandbox.output.progress import NoProgress, ProgressReport
from sandbox.output.trajectory import Trajectory
from sandbox.output.video import open_writer, video_names, write_image
from sandbox.scene.assemble import Assembly, assemble
from sandbox.scene.load import scene_from_data, to_toml
from sandbox.scene.model import ColorBy, Scene
from sandbox.scene.overrides import dotted, steps


@dataclass(frozen=True)
class RerenderOptions:
    """Where and how a stored run is drawn."""

    out: Path
    """Folder of the new pictures; not that of the run."""
    renderer: str = "taichi"
    video: str = "mp4"
    arch: str = "cpu"
    threads: int | None = None


def check_changes(keys: Sequence[str]) -> None:
    """Raise SceneError where a dotted key is more than how a stored run looks."""
    for key in keys:
        parts = key.split(".")
        looks = parts[0] == "render" and len(parts) > 1
        colors = parts[0] in ("bodies", "colliders") and len(parts) == 3 and parts[2] == "color"
        if not (looks or colors):
            raise SceneError(
                f"--set {key}: a stored run is not simulated again, so only render.* and colours can change; "
                "run the scene for all else"
            )


def changed_scene(trajectory: Trajectory, changes: Mapping[str, Any], options: Mapping[str, str]) -> Scene:
    """The scene of a stored run with another look; ``options`` tells which option a change came from.

    Raises SceneError where a change is not one of looks, or would need pictures that were not stored.
    """
    data = copy.deepcopy(trajectory.data)
    check_changes([dotted(steps(data, key)) for key in changes if key not in options])
    scene = scene_from_data(data, changes, source=str(trajectory.path), options=options)
    picture_step(trajectory, scene)
    return scene


def picture_step(trajectory: Trajectory, scene: Scene) -> int:
    """Every how manyth stored picture is drawn. Raises SceneError where pictures would be needed between them."""
    stored, wanted = trajectory.scene.render.fps, scene.render.fps
    step = max(1, round(stored / wanted))
    if not math.isclose(step * wanted, stored, rel_tol=1e-9):
        raise SceneError(
            f"render.fps = {wanted:g}: the run holds {stored:g} pictures a second; "
            f"{stored:g}, {stored / 2:g}, {stored / 3:g} and so on can be drawn"
        )
    return step


class Playback:
    """A stored run in the fields that renderers read: positions, velocities and torn springs, and nothing else."""

    def __init__(self, trajectory: Trajectory, scene: Scene, arch: str = "cpu", threads: int | None = None) -> None:
        """Start Taichi in the precision of the run and make the fields.

        Raises SceneError where the scene makes other bodies than were stored.
        """
        from sandbox import runtime
        from sandbox.forces.tears import Tears
        from sandbox.state import ParticleState

        self.scene = scene
        self.assembly = assembled(trajectory, scene)
        runtime.start(arch, trajectory.precision, threads)
        builder = runtime.fields_builder()
        self.state = ParticleState(builder, self.assembly, predicts_velocity=False)
        self._tears = Tears(builder, self.assembly.spring_count) if "torn" in trajectory.stored else None
        builder.finalize()
        runtime.register(self)
        self._is_closed = False
        self.laws: list[Any] = []
        """None: strains are stored."""
        self.time = 0.0
        """Of the frame that the fields hold [s]."""

    @property
    def torn(self) -> Any:
        """Field of marks of torn springs; None where none can tear."""
        return None if self._tears is None else self._tears.torn

    def hold(self, frame: Frame) -> None:
        """Fill the fields with a frame. Raises RuntimeError where Taichi was started anew, which took them away."""
        if self._is_closed:
            raise RuntimeError("the playback is closed")
        order = self.assembly.internal_order
        self.state.write(order(frame.positions), order(frame.velocities))
        if self._tears is not None and frame.torn is not None:
            self._tears.remember({"springs.torn": frame.torn.astype(np.float64)})
        self.time = frame.time

    def suspend(self) -> None:
        """Let go before Taichi is started anew."""
        self._is_closed = True


def assembled(trajectory: Trajectory, scene: Scene) -> Assembly:
    """The assembly of a stored run's scene. Raises SceneError where it makes other bodies than were stored."""
    assembly = assemble(scene)
    if assembly.particle_count != trajectory.particle_count or trajectory.spring_count not in (
        None,
        assembly.spring_count,
    ):
        raise SceneError(
            f"{trajectory.path}: holds {trajectory.particle_count} particles, but its scene makes "
            f"{assembly.particle_count} now; it was stored by another version"
        )
    return assembly


class StoredPictures:
    """Draws frames of a stored run."""

    def __init__(self, trajectory: Trajectory, scene: Scene, renderer: str, arch: str, threads: int | None) -> None:
        """``scene`` says how they look."""
        from sandbox.particle_values import ParticleValues
        from sandbox.render import create_renderer

        self._playback = Playback(trajectory, scene, arch, threads)
        self._renderer = create_renderer(renderer, self._playback.assembly.appearance, scene.render)
        self._values: Any = None
        self._by = scene.render.color
        if self._by is not ColorBy.BODY:
            self._values = ParticleValues(self._playback, self._by)
            if scene.render.color_max is None:
                self._renderer.set_color_max(self._values.expected_largest())

    def draw(self, frame: Frame) -> NDArray[np.uint8]:
        """The picture of a frame."""
        playback = self._playback
        playback.hold(frame)
        values = None
        if self._by is ColorBy.SPEED:
            values = self._values.update()
        elif self._values is not None:
            values = self._values.show(playback.assembly.internal_order(_strain_of(frame)))
        state = playback.state
        return self._renderer.draw(state.x, state.slot, values, time=playback.time, torn=playback.torn)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()


def _strain_of(frame: Frame) -> NDArray[np.float64]:
    return np.zeros(len(frame.positions)) if frame.strain is None else frame.strain


def rerender(
    trajectory: Trajectory, scene: Scene, options: RerenderOptions, progress: ProgressReport | None = None
) -> list[str]:
    """Draw a stored run with the looks of ``scene`` into a folder of its own: video, poster and scene.toml.

    Returns the names of the files. Raises SceneError where the folder is that of the run.
    """
    if _same(options.out, trajectory.path.parent):
        raise SceneError(f"--out {options.out}: is the run itself, which would be lost; choose another folder")
    step = picture_step(trajectory, scene)
    names = ("poster.png", "scene.toml", *video_names(options.video))
    folder, pace = RunFolder(options.out, names), _Pace(progress)
    with folder.discarded_on_failure():
        with contextlib.closing(
            StoredPictures(trajectory, scene, options.renderer, options.arch, options.threads)
        ) as pictures:
            poster = _draw_all(trajectory, pictures, folder, step, options.video, scene.render.fps, pace)
        write_image(folder.partial / "poster.png", poster)
        folder.write_text("scene.toml", to_toml(scene))
        return folder.publish()


def _draw_all(
    trajectory: Trajectory,
    pictures: StoredPictures,
    folder: RunFolder,
    step: int,
    video: str,
    fps: float,
    pace: "_Pace",
) -> NDArray[np.uint8]:
    """Write the video; returns the picture of most merit."""
    last = len(trajectory) - 1
    writer = open_writer(folder.partial, video, fps)
    best: tuple[float, NDArray[np.uint8]] | None = None
    # The start is no picture of the run, unless there is nothing else.
    for number in range(step, last + 1, step) if last >= step else [last]:
        frame = trajectory.frame(number)
        picture = pictures.draw(frame)
        writer.write(picture)
        if best is None or frame.merit > best[0]:
            best = (frame.merit, picture)
        pace.update(frame.time)
    writer.close()
    writer.settle()
    assert best is not None
    return best[1]


def export_stored(
    trajectory: Trajectory, scene: Scene, formats: Sequence[str], out: Path, progress: ProgressReport | None = None
) -> list[str]:
    """Write the frames of a stored run as mesh files, beside what the folder holds; returns the names of the files."""
    step = picture_step(trajectory, scene)
    folder, pace = RunFolder(out), _Pace(progress)
    with folder.discarded_on_failure():
        assembly = assembled(trajectory, scene)
        writers = open_exports(formats, folder, assembly, trajectory.precision, trajectory.name, len(trajectory) - 1)
        for number in range(0, len(trajectory), step):
            frame = trajectory.frame(number)
            for writer in writers:
                writer.write(frame)
            pace.update(frame.time)
        for writer in writers:
            writer.close()
        return folder.publish(adds=True)


class _Pace:
    """Tells progress how far it is, and how fast."""

    def __init__(self, progress: ProgressReport | None) -> None:
        self._progress, self._begin = progress or NoProgress(), clock.perf_counter()

    def update(self, time: float) -> None:
        """All until ``time`` [s] is done."""
        self._progress.update(time, time / (clock.perf_counter() - self._begin))


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()
