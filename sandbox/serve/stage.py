"""The scene as viser shows it: made once, then moved."""

import re
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandbox.render.camera import frame_2d, frame_3d
from sandbox.scene.appearance import Appearance, FloatArray, IntArray
from sandbox.scene.model import Scene
from sandbox.serve import surfaces
from sandbox.serve.solids import build_blocks, quaternion

if TYPE_CHECKING:
    import viser

OnDrag = Callable[[Any], Coroutine[Any, Any, None]]

_FLAT_ANGLE = np.radians(8.0)
"""Vertical field of view on 2D scenes: from afar, so that all of it is seen straight on."""
_ASPECT = 4.0 / 3.0
"""Width over height of the picture that is left beside the controls, on a usual screen [1]."""
_OUTLINE_SHADE = 0.55
"""Brightness of outlines beside that of their bodies [1]."""


class Stage:
    """Bodies and colliders in a viser scene; ``on_drag`` is called when a body is dragged with the mouse."""

    def __init__(self, server: "viser.ViserServer", scene: Scene, appearance: Appearance, on_drag: OnDrag) -> None:
        self._server, self._appearance = server, appearance
        self._names = [f"{index} {re.sub(r'[^ -.0-~]', '_', body.name)}" for index, body in enumerate(scene.bodies)]
        self._colors: list[Any] = [
            tuple(round(255.0 * float(part)) for part in color) for color in appearance.body_colors
        ]
        self._shown = appearance.shown()
        self._patches = surfaces.patches(appearance, self._shown)
        self._rods = surfaces.rods(appearance)
        self._balls = surfaces.balls(appearance)
        self._frame(scene)
        with server.atomic():
            self._surface_nodes = [self._add_patch(patch, on_drag) for patch in self._patches]
            self._rod_nodes = [self._add_rods(rods, on_drag) for rods in self._rods]
            self._ball_nodes = [self._add_balls(balls, on_drag) for balls in self._balls]
            self._movers = self._add_blocks()

    @property
    def vertex_count(self) -> int:
        """Vertices of all surfaces as they are shown now."""
        return sum(len(patch.points) for patch in self._patches)

    def light(self, shadows: bool) -> None:
        """Have things throw shadows, or not."""
        self._server.scene.configure_default_lights(cast_shadow=shadows)

    def show(self, positions: FloatArray, time: float, torn: IntArray | None, torn_is_new: bool) -> None:
        """Show particles at positions [m], shape (particle_count, d) in the simulation's order, at a time [s].

        ``torn`` is nonzero where springs have torn, None where none has; ``torn_is_new`` where it is another than the
        last time.
        """
        drawn = self._appearance.drawn_points(positions, torn)
        with self._server.atomic():
            if torn_is_new:
                self._open(torn)
            for patch, node in zip(self._patches, self._surface_nodes, strict=True):
                node.vertices = patch.vertices(drawn)
            for rods, (node, joints) in zip(self._rods, self._rod_nodes, strict=True):
                node.batched_positions, node.batched_wxyzs, node.batched_scales = rods.placed(drawn, self._shown)
                joints.batched_positions = surfaces.in_space(drawn[rods.joints])
            for balls, node in zip(self._balls, self._ball_nodes, strict=True):
                node.batched_positions = surfaces.in_space(positions[balls.particles])
            for pose, node in self._movers:
                place, rotation = pose(time)
                node.position, node.wxyz = place, quaternion(rotation)
        self._server.flush()

    def _open(self, torn: IntArray | None) -> None:
        """Other triangles are seen, since springs have torn or are whole again."""
        self._shown = self._appearance.shown(torn)
        self._patches = surfaces.patches(self._appearance, self._shown)
        for patch, node in zip(self._patches, self._surface_nodes, strict=True):
            node.faces = patch.faces
        for rods, (_, joints) in zip(self._rods, self._rod_nodes, strict=True):
            joints.batched_scales = rods.joint_sizes(self._shown)

    def _frame(self, scene: Scene) -> None:
        """Where browsers look from at first: what the renderers' camera shows, from farther for a narrower picture."""
        camera, bounds, view = scene.render.camera, self._appearance.bounds, self._server.initial_camera
        width, height = scene.render.size
        size = (min(width, round(_ASPECT * height)), height)
        self._server.scene.set_up_direction("+y")
        if scene.dimension == 2:
            flat = frame_2d(camera, bounds, size)
            extent = flat.size[1] / flat.scale * (1.0 if camera.height is None else width / size[0])
            target = np.array([*flat.center, 0.0])
            eye = target + np.array([0.0, 0.0, extent / (2.0 * np.tan(_FLAT_ANGLE / 2.0))])
            view.fov = float(_FLAT_ANGLE)
        else:
            pinhole = frame_3d(camera, bounds, size)
            eye = pinhole.eye
            middle = bounds.mean(axis=0) if camera.target is None else np.array(camera.target)
            target = eye + pinhole.forward * max(float((middle - eye) @ pinhole.forward), 1e-3)
            if camera.eye is not None:
                eye = target + (eye - target) * width / size[0]
            view.fov = float(np.radians(camera.field_of_view))
        distance = float(np.linalg.norm(target - eye))
        view.position, view.look_at, view.up = eye, target, (0.0, 1.0, 0.0)
        view.near, view.far = 0.01 * distance, 100.0 * distance

    def _add_patch(self, patch: surfaces.Patch, on_drag: OnDrag) -> Any:
        is_open = bool(self._appearance.body_two_sided[patch.body]) or self._appearance.dimension == 2
        # What tears shows its inside, even where it has none.
        is_open = is_open or self._appearance.tears
        node = self._server.scene.add_mesh_simple(
            f"/bodies/{self._names[patch.body]}",
            np.zeros((len(patch.points), 3), dtype=np.float32),
            patch.faces,
            color=self._colors[patch.body],
            side="double" if is_open else "front",
        )
        node.on_drag("left")(on_drag)
        return node

    def _add_rods(self, rods: surfaces.Rods, on_drag: OnDrag) -> tuple[Any, Any]:
        shade = _OUTLINE_SHADE if rods.is_outline else 1.0
        color = tuple(round(shade * part) for part in self._colors[rods.body])
        name = f"/bodies/{self._names[rods.body]} {'outline' if rods.is_outline else 'rods'}"
        node = self._batch(name, *_cylinder(12), len(rods.ends), color)
        sizes = rods.joint_sizes(self._shown)
        joints = self._batch(f"{name} joints", *_ball(1), len(rods.joints), color, sizes)
        for each in (node, joints):
            each.on_drag("left")(on_drag)
        return node, joints

    def _add_balls(self, balls: surfaces.Balls, on_drag: OnDrag) -> Any:
        sizes = np.repeat(balls.radius[:, None], 3, axis=1).astype(np.float32)
        name = f"/bodies/{self._names[balls.body]} particles"
        node = self._batch(name, *_ball(2), len(balls.particles), self._colors[balls.body], sizes)
        node.on_drag("left")(on_drag)
        return node

    def _batch(
        self,
        name: str,
        vertices: FloatArray,
        faces: NDArray[np.uint32],
        count: int,
        color: tuple[int, ...],
        sizes: NDArray[np.float32] | None = None,
    ) -> Any:
        return self._server.scene.add_batched_meshes_simple(
            name,
            vertices,
            faces,
            batched_wxyzs=np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (count, 1)),
            batched_positions=np.zeros((count, 3), dtype=np.float32),
            batched_scales=np.zeros((count, 3), dtype=np.float32) if sizes is None else sizes,
            batched_colors=np.array(color, dtype=np.uint8),
            lod="off",
        )

    def _add_blocks(self) -> list[tuple[Any, Any]]:
        """Colliders; the result are those that move, each with where it is."""
        movers = []
        for index, block in enumerate(build_blocks(self._appearance.colliders, self._appearance.bounds)):
            place, rotation = block.pose(0.0)
            name, wxyz = f"/colliders/{index}", quaternion(rotation)
            node = self._server.scene.add_mesh_simple(
                name,
                block.vertices,
                block.faces,
                color=block.color,
                position=place,
                wxyz=wxyz,
            )
            if block.moves:
                movers.append((block.pose, node))
            if block.grid is not None:
                self._add_grid(f"{name} grid", block.grid, place + 1e-3 * block.grid * rotation[:, 2], wxyz)
        return movers

    def _add_grid(self, name: str, spacing: float, place: FloatArray, wxyz: Any) -> None:
        self._server.scene.add_grid(
            name,
            width=20.0 * spacing,
            height=20.0 * spacing,
            plane="xy",
            cell_size=spacing,
            section_size=5.0 * spacing,
            cell_color=(170, 175, 182),
            section_color=(150, 155, 162),
            shadow_opacity=0.0,
            position=place,
            wxyz=wxyz,
        )


def _cylinder(sides: int) -> tuple[FloatArray, NDArray[np.uint32]]:
    """The mantle of a cylinder of radius and length 1 that stands on the origin along z."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    low = np.arange(sides)
    following = np.roll(low, -1)
    faces = [np.stack([low, following, following + sides], axis=1), np.stack([low, following + sides, low + sides], 1)]
    return np.concatenate([ring, ring + np.array([0.0, 0.0, 1.0])]), np.concatenate(faces).astype(np.uint32)


def _ball(subdivisions: int) -> tuple[FloatArray, NDArray[np.uint32]]:
    """A ball of radius 1."""
    import trimesh.creation

    shape = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.asarray(shape.vertices), np.asarray(shape.faces, dtype=np.uint32)
