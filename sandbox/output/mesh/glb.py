"""GLB: the moment of the poster, with the colliders, as one binary glTF file."""

from pathlib import Path
from typing import Any

import numpy as np

from sandbox.files import replace_when_whole
from sandbox.output.frames import FloatArray, Frame
from sandbox.output.mesh.solids import Prop, props
from sandbox.output.mesh.surface import BodyShape, Surfaces
from sandbox.render import palette
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import ColorBy

_SIDES = 8
"""Sides of a rope or strut."""
_THIN = 0.05
"""Radius of outlines that nothing fills, over the length of a spring."""


class GlbWriter:
    """Keeps the frame that is worth most, and writes it at the end."""

    def __init__(self, path: Path, surfaces: Surfaces, appearance: Appearance, by: ColorBy) -> None:
        """``by`` is what colours show."""
        self._path, self._surfaces, self._appearance, self._by = path, surfaces, appearance, by
        self._best: Frame | None = None

    def write(self, frame: Frame) -> None:
        """Keep the frame if it is worth more than those before."""
        if self._best is None or frame.merit > self._best.merit:
            self._best = frame

    def close(self) -> None:
        """Write the file, if there was a frame."""
        if self._best is None:
            return
        import trimesh

        scene = trimesh.Scene()
        for shape in map(BodyShape.compact, self._surfaces.at(self._best)):
            for part, mesh in self._meshes(shape) if shape.present else ():
                name = f"{shape.parts.name}{part}"
                scene.add_geometry(mesh, node_name=name, geom_name=name)
        for prop in props(self._appearance):
            scene.add_geometry(
                _collider(prop), node_name=prop.name, geom_name=prop.name, transform=prop.pose(self._best.time)
            )
        if not scene.geometry:
            return  # the format has no empty scenes
        with replace_when_whole(self._path, syncs=False) as path:
            path.write_bytes(scene.export(file_type="glb", include_normals=True))

    def _meshes(self, shape: BodyShape) -> list[tuple[str, Any]]:
        """The surface of a body, its ropes, its balls: those that there are."""
        found = []
        if len(shape.triangles):
            found.append(("", self._colored(shape.vertices, shape.triangles, shape.colors, shape)))
        if len(shape.lines):
            radius = np.where(shape.line_radius > 0.0, shape.line_radius, _THIN * self._appearance.element_size)
            vertices, triangles = _tubes(shape.vertices[shape.lines], radius)
            ends = np.repeat(shape.lines, _SIDES, axis=1).ravel()
            found.append((".lines", self._colored(vertices, triangles, shape.colors[ends], shape)))
        if len(shape.dots):
            vertices, triangles = _balls(shape.vertices[shape.dots], shape.parts.dot_radius)
            owner = np.repeat(shape.dots, len(vertices) // len(shape.dots))
            found.append((".particles", self._colored(vertices, triangles, shape.colors[owner], shape)))
        return found

    def _colored(self, vertices: FloatArray, triangles: Any, colors: FloatArray, shape: BodyShape) -> Any:
        import trimesh

        if self._by is ColorBy.BODY:
            visual: Any = _material(palette.to_linear(shape.parts.color), shape.parts.two_sided)
        else:
            # What glTF calls colours of vertices is linear light.
            linear = np.round(255.0 * palette.to_linear(colors)).astype(np.uint8)
            visual = trimesh.visual.ColorVisuals(vertex_colors=np.pad(linear, ((0, 0), (0, 1)), constant_values=255))
        mesh = trimesh.Trimesh(vertices=vertices, faces=triangles, process=False, validate=False)
        mesh.visual = visual
        return mesh


def _material(linear: FloatArray, two_sided: bool) -> Any:
    import trimesh

    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*map(float, linear), 1.0], metallicFactor=0.0, roughnessFactor=0.5, doubleSided=two_sided
    )
    return trimesh.visual.TextureVisuals(material=material)


def _collider(prop: Prop) -> Any:
    import trimesh

    pieces = []
    if len(prop.corners):
        faces = np.arange(3 * len(prop.corners)).reshape(-1, 3)
        pieces.append(trimesh.Trimesh(vertices=prop.corners.reshape(-1, 3), faces=faces, process=False))
    for (start, end), radius in zip(prop.ends, prop.radius, strict=True):
        if np.array_equal(start, end):
            ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
            ball.apply_translation(start)
            pieces.append(ball)
        else:
            rod = trimesh.creation.capsule(height=float(np.linalg.norm(end - start)), radius=radius, count=[24, 24])
            rod.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], end - start))
            # However the shape is centred in its own axes: its middle is that of the rod.
            rod.apply_translation((start + end) / 2 - rod.bounds.mean(axis=0))
            pieces.append(rod)
    mesh = trimesh.util.concatenate(pieces)
    mesh.visual = _material(prop.color, two_sided=True)
    return mesh


def _tubes(ends: FloatArray, radius: FloatArray) -> tuple[FloatArray, Any]:
    """Open prisms around lines, shape (L, 2, 3): their vertices and triangles."""
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    helper = np.where(np.abs(along[:, :1]) < 0.9, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    first = np.cross(along, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    second = np.cross(along, first)
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    ring = np.cos(angles)[None, :, None] * first[:, None] + np.sin(angles)[None, :, None] * second[:, None]
    vertices = (ends[:, :, None] + radius[:, None, None, None] * ring[:, None]).reshape(-1, 3)
    k, after = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    one = np.concatenate(
        [np.stack([k, after, after + _SIDES], axis=1), np.stack([k, after + _SIDES, k + _SIDES], axis=1)]
    )
    triangles = (one[None] + 2 * _SIDES * np.arange(len(ends))[:, None, None]).reshape(-1, 3)
    return vertices, triangles


def _balls(centres: FloatArray, radius: FloatArray) -> tuple[FloatArray, Any]:
    """Spheres: their vertices and triangles."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    vertices = centres[:, None] + radius[:, None, None] * np.asarray(ball.vertices)[None]
    triangles = np.asarray(ball.faces)[None] + len(ball.vertices) * np.arange(len(centres))[:, None, None]
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)
