"""Small scenes for the renderer's tests."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sandbox import runtime
from sandbox.render import palette
from sandbox.scene.appearance import Appearance
from sandbox.scene.cells import Cells, FaceCells
from sandbox.scene.model import HalfSpace


@pytest.fixture(scope="session", autouse=True)
def taichi_started() -> None:
    """Taichi, started once."""
    runtime.start(arch="cpu", precision="f32")


@pytest.fixture(scope="session")
def ground() -> HalfSpace:
    """The plane y = 0, solid below."""
    return HalfSpace(kind="half_space", point=(0.0, 0.0, 0.0), normal=(0.0, 1.0, 0.0))


@pytest.fixture(scope="session")
def make_appearance() -> Callable[..., Appearance]:
    """Build an appearance from what a test names."""

    def build(dimension: int = 3, body_count: int = 1, **parts: Any) -> Appearance:
        def bodies(kind: str) -> np.ndarray:
            return np.asarray(parts.get(f"{kind}_body", np.zeros(len(parts.get(f"{kind}s", ())))), dtype=np.int32)

        used = [
            np.max(parts[name], initial=-1) for name in ("triangles", "outline", "capsules", "spheres") if name in parts
        ]
        return Appearance(
            dimension=dimension,
            triangles=np.asarray(parts.get("triangles", ()), dtype=np.int32).reshape(-1, 3),
            triangle_body=bodies("triangle"),
            outline=np.asarray(parts.get("outline", ()), dtype=np.int32).reshape(-1, 2),
            outline_body=np.zeros(len(parts.get("outline", ())), dtype=np.int32),
            capsules=np.asarray(parts.get("capsules", ()), dtype=np.int32).reshape(-1, 2),
            capsule_radius=np.asarray(parts.get("capsule_radius", ()), dtype=float),
            capsule_body=bodies("capsule"),
            spheres=np.asarray(parts.get("spheres", ()), dtype=np.int32),
            sphere_radius=np.asarray(parts.get("sphere_radius", ()), dtype=float),
            sphere_body=bodies("sphere"),
            body_colors=np.asarray(parts.get("body_colors", palette.body_palette(body_count)), dtype=float),
            body_two_sided=np.asarray(parts.get("two_sided", np.zeros(body_count)), dtype=bool),
            colliders=tuple(parts.get("colliders", ())),
            bounds=np.asarray(parts.get("bounds", [[-1.0] * dimension, [1.0] * dimension]), dtype=float),
            element_size=0.1,
            particle_count=parts.get("particle_count", int(max(used, default=-1)) + 1),
            carried_nodes=np.asarray(parts.get("carried_nodes", np.zeros((0, 1))), dtype=np.int32),
            carried_weights=np.asarray(parts.get("carried_weights", np.zeros((0, 1))), dtype=float),
            body_radius=None if "body_radius" not in parts else np.asarray(parts["body_radius"], dtype=float),
            cells=hanging_cells(dimension, body_count, parts),
        )

    return build


def hanging_cells(dimension: int, body_count: int, parts: dict[str, Any]) -> Cells | None:
    """A cell for every element, with the springs that a test names for it; None where it names none."""
    names = {"triangles": "triangle_springs", "outline": "outline_spring", "capsules": "capsule_spring"}
    if not any(name in parts for name in names.values()):
        return None
    rows, faces = [], []
    for elements, name in names.items():
        count = len(parts.get(elements, ()))
        own = np.full((count, 3), -1)
        if name in parts:
            springs = np.asarray(parts[name]).reshape(count, -1)
            own[:, : springs.shape[1]] = springs
        faces.append(FaceCells.of(sum(map(len, rows)) + np.arange(count)))
        rows.append(own)
    springs = np.concatenate(rows)
    opens = np.zeros(body_count, dtype=bool)
    if "triangle_springs" in parts and dimension == 3:
        opens[np.asarray(parts["triangle_body"], dtype=int)[np.any(rows[0] >= 0, axis=1)]] = True
    start = np.concatenate([[0], np.cumsum((springs >= 0).sum(axis=1))]).astype(np.int32)
    held = springs[springs >= 0].astype(np.int32)
    return Cells(start, held, np.ones(len(springs), dtype=np.int32), *faces, opens)


@pytest.fixture(scope="session")
def make_field() -> Callable[..., Any]:
    """Put positions, shape (slot_count, particle_count, dimension), into a Taichi field."""
    import taichi as ti

    def build(*slots: Any, precision: Any = ti.f32) -> Any:
        rows = np.asarray(slots, dtype=np.float32 if precision == ti.f32 else np.float64)
        field = ti.Vector.field(rows.shape[2], precision, shape=rows.shape[:2])
        field.from_numpy(rows)
        return field

    return build


@pytest.fixture(scope="session")
def cube() -> tuple[np.ndarray, np.ndarray]:
    """Surface of the unit cube with 6 cells an edge: points (count, 3) centred on the origin, triangles outward."""
    cells = 6
    points, triangles = [], []
    for axis in range(3):
        for side in (-0.5, 0.5):
            first = len(points)
            for i in range(cells + 1):
                for j in range(cells + 1):
                    point = np.zeros(3)
                    point[axis] = side
                    point[(axis + 1) % 3], point[(axis + 2) % 3] = i / cells - 0.5, j / cells - 0.5
                    points.append(point)
            for i in range(cells):
                for j in range(cells):
                    a = first + i * (cells + 1) + j
                    b, c, d = a + cells + 1, a + cells + 2, a + 1
                    faces = [(a, b, c), (a, c, d)]
                    triangles += faces if side > 0 else [face[::-1] for face in faces]
    merged, inverse = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    return merged, inverse.ravel()[np.array(triangles)].astype(np.int32)
