"""What a run writes down besides pictures: its trajectory, and its surfaces as mesh files."""

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from sandbox.errors import SceneError
from sandbox.output.folder import RunFolder
from sandbox.output.frames import Frame, FrameWriter, Stem
from sandbox.output.kept_frames import KEPT_FRAMES, KeptFrames
from sandbox.output.trajectory import RunInfo, TrajectoryKind, TrajectoryWriter, check_kind
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import ColorBy

if TYPE_CHECKING:
    from sandbox.simulation import Simulation


class ExportFormat(StrEnum):
    """Kinds of mesh files."""

    PLY = "ply"
    FACES = "faces"
    """PLY without the edges of ropes and struts, which not all programs know."""
    OBJ = "obj"
    VTU = "vtu"
    SPRINGS = "springs"
    """The springs as lines, also VTU."""
    USD = "usd"
    GLB = "glb"


def check_formats(option: str, formats: Sequence[str]) -> tuple[ExportFormat, ...]:
    """The formats of these names, ready to be written. Raises SceneError for others, or where a package is absent."""
    for name in formats:
        if name not in tuple(ExportFormat):
            raise SceneError(f"{option} {name}: must be of {', '.join(ExportFormat)}")
    if ExportFormat.USD in formats:
        from sandbox.output.mesh.usd import check_usd

        check_usd()
    return tuple(dict.fromkeys(map(ExportFormat, formats)))


def check_outputs(trajectory: str | None, exports: Sequence[str]) -> None:
    """Raise SceneError where a run could not write these."""
    check_kind("--trajectory", trajectory)
    check_formats("--export", exports)


def open_exports(
    formats: Sequence[str], folder: RunFolder, assembly: Assembly, precision: str, name: str, pictures: int
) -> list[FrameWriter]:
    """Writers of these formats into a run folder; ``pictures`` is the number of the last frame to come."""
    chosen = check_formats("--export", formats)
    if not chosen:
        return []
    from sandbox.output.mesh import glb, polygons, vtu
    from sandbox.output.mesh.surface import Surfaces

    surfaces, stem = Surfaces(assembly), Stem(name, pictures)
    scene, look = assembly.scene, assembly.appearance
    real = np.float64 if precision == "f64" else np.float32

    def open_one(kind: ExportFormat) -> tuple[list[str], FrameWriter]:
        place = folder.partial / str(kind)
        match kind:
            case ExportFormat.PLY:
                return [kind], polygons.PlyWriter(place, stem, surfaces, real)
            case ExportFormat.FACES:
                return [kind], polygons.PlyWriter(place, stem, surfaces, real, has_edges=False)
            case ExportFormat.OBJ:
                return [kind], polygons.ObjWriter(place, stem, surfaces, 17 if precision == "f64" else 9)
            case ExportFormat.VTU:
                pvd = f"{name}.pvd"
                return [kind, pvd], vtu.VtuSurfaceWriter(place, stem, surfaces, real, folder.partial / pvd)
            case ExportFormat.SPRINGS:
                pvd = f"{name}_springs.pvd"
                return [kind, pvd], vtu.VtuSpringWriter(place, stem, assembly, real, folder.partial / pvd)
            case ExportFormat.GLB:
                file = f"{name}.glb"
                return [file], glb.GlbWriter(folder.partial / file, surfaces, look, scene.render.color)
            case ExportFormat.USD:
                from sandbox.output.mesh.usd import UsdWriter

                file = f"{name}.usdc"
                fps, by = scene.render.fps, scene.render.color
                return [file], UsdWriter(folder.partial / file, surfaces, look, fps, by)

    opened = [open_one(kind) for kind in chosen]
    folder.claim([file for files, _ in opened for file in files])
    return [writer for _, writer in opened]


class FrameRecorder:
    """Hands the state of a simulation to all who write it down. Where nobody does, it costs nothing."""

    def __init__(self, simulation: "Simulation", writers: list[FrameWriter]) -> None:
        """``writers`` are closed by :meth:`close`."""
        self.simulation, self.writers = simulation, writers
        self._values = None
        if writers and simulation.spring_count:
            from sandbox.particle_values import ParticleValues

            self._values = ParticleValues(simulation, ColorBy.STRAIN)

    @classmethod
    def open(
        cls,
        simulation: "Simulation",
        folder: RunFolder,
        name: str,
        arch: str,
        trajectory: str | None,
        exports: Sequence[str],
        pictures: int,
        earlier: int = 0,
    ) -> "FrameRecorder":
        """A recorder of the kinds of trajectory and mesh files that a run of so many pictures wants.

        ``earlier`` frames that the folder keeps are written again first.
        """
        scene = simulation.scene
        writers = open_exports(exports, folder, simulation.assembly, simulation.precision, name, pictures)
        kind, tears = check_kind("--trajectory", trajectory), simulation.torn is not None
        if kind is not None:
            run = RunInfo(name, simulation.precision, arch, simulation.particle_count, simulation.spring_count, tears)
            writers.append(TrajectoryWriter(folder.partial, TrajectoryKind(kind), scene, run))
        if writers:
            kept = KeptFrames(
                folder.partial / KEPT_FRAMES,
                simulation.particle_count,
                simulation.assembly.dimension,
                simulation.spring_count if tears else 0,
                simulation.spring_count > 0,
                np.float64 if simulation.precision == "f64" else np.float32,
                earlier,
            )
            for frame in kept.frames():
                for writer in writers:
                    writer.write(frame)
            writers.append(kept)
        return cls(simulation, writers)

    def write(self, number: int, merit: float) -> None:
        """Write down the state now; ``merit`` is what it is worth as a poster."""
        if not self.writers:
            return
        simulation = self.simulation
        frame = Frame(
            number=number,
            time=simulation.time,
            positions=simulation.positions(),
            velocities=simulation.velocities(),
            strain=self._strain(),
            torn=None if simulation.torn is None else simulation.torn.to_numpy()[: simulation.spring_count] != 0,
            merit=merit,
        )
        for writer in self.writers:
            writer.write(frame)

    def _strain(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None:
        if self._values is None:
            return None
        self._values = self._values.current()
        values = self._values.update().to_numpy()[: self.simulation.particle_count].astype(np.float64)
        return self.simulation.assembly.scene_order(values)

    def close(self) -> None:
        """Finish all files."""
        for writer in self.writers:
            writer.close()
