"""One run of a study: a scene with its settings, what is looked at of it, and a name that is the same everywhere."""

import contextlib
import functools
import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from sandbox import __version__
from sandbox.scene.model import IntegratorName, Precision, Scene, Switch

_PACKAGE = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Settings:
    """What a user may choose of the way in which time is stepped."""

    integrator: IntegratorName
    dt: float
    """Longest step [s]."""
    precision: Precision
    iterations: int | None = None
    """Iterations or sweeps a step; None for the scheme's own."""

    def applied_to(self, scene: Scene) -> Scene:
        """The scene with these settings."""
        return with_solver(
            scene,
            integrator=self.integrator,
            dt=self.dt,
            precision=self.precision,
            iterations=self.iterations,
            adapt=None,
        )

    @property
    def line(self) -> str:
        """All but the step, in few words."""
        count = "" if self.iterations is None else f" x{self.iterations}"
        return f"{self.integrator}{count} {self.precision}"

    @property
    def label(self) -> str:
        """In few words."""
        return f"{self.line} {self.dt:.3g} s"

    def fragment(self) -> str:
        """As TOML that any scene file takes."""
        values: dict[str, Any] = {"integrator": str(self.integrator), "dt": self.dt, "precision": str(self.precision)}
        if self.iterations is not None:
            values["iterations"] = self.iterations
        return tomli_w.dumps({"solver": values})


def with_solver(scene: Scene, **changes: Any) -> Scene:
    """The scene with other solver settings, and these to its end."""
    actions = tuple(action for action in scene.actions if not isinstance(action, Switch))
    return scene.model_copy(update={"solver": scene.solver.model_copy(update=changes), "actions": actions})


@dataclass(frozen=True)
class Trial:
    """A scene to be run for a number of pictures."""

    scene: Scene
    frames: int
    """Pictures that it takes."""
    samples: tuple[int, ...]
    """Pictures after which positions are kept, counted from 1, ascending."""
    arch: str = "cpu"
    threads: int | None = 1
    """Threads of one run; its trajectory does not depend on them."""
    cost: float = 1.0
    """About how long it takes [s]: for the order of runs, no more."""

    @functools.cached_property
    def group(self) -> str:
        """The same for trials that one simulation can do, one after the other: all but the step agrees."""
        return _digest(scene=_plain(with_solver(self.scene, dt=1.0)), arch=self.arch, threads=self.threads)

    @functools.cached_property
    def key(self) -> str:
        """Name of the outcome: the same for the same scene, settings, length and engine."""
        return _digest(
            scene=_plain(self.scene), frames=self.frames, samples=self.samples, arch=self.arch, engine=engine_digest()
        )

    def on(self, threads: int | None) -> "Trial":
        """The same on so many threads."""
        return replace(self, threads=threads)


def even_samples(frames: int, most: int) -> tuple[int, ...]:
    """At most so many of a number of pictures, the last among them, at even distances."""
    count = max(1, min(frames, most))
    return tuple(sorted({round(frames * (k + 1) / count) for k in range(count)}))


@functools.cache
def engine_digest() -> str:
    """Changes with whatever may change a trajectory: the version, and every source file of the package."""
    return sources_digest(_PACKAGE)


def sources_digest(package: Path) -> str:
    """Of the version and of names and contents of all Python files under a folder, wherever they are in it."""
    digest = hashlib.sha256(__version__.encode())
    for path in sorted(package.rglob("*.py")):
        for part in (path.relative_to(package).as_posix().encode(), path.read_bytes()):
            digest.update(f"{len(part)}:".encode() + part)
    return digest.hexdigest()[:16]


def _plain(scene: Scene) -> dict[str, Any]:
    """What of a scene decides on its trajectory."""
    plain = scene.model_dump(mode="json", exclude={"title", "description", "duration"})
    plain["render"] = {"fps": scene.render.fps}
    named = [getattr(part, "file", None) for part in (*(body.shape for body in scene.bodies), *scene.colliders)]
    plain["files"] = [_file_digest(file) for file in named if file is not None]
    return plain


def _file_digest(file: str) -> str:
    """Of the contents of a mesh file; nothing where there is none, which is an error of the run's own."""
    with contextlib.suppress(OSError):
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:24]
    return ""


def _digest(**parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]
