"""USD: the whole run in one .usdc file, a prim a body with a sample a picture."""

from pathlib import Path
from typing import Any

import numpy as np

from sandbox.errors import SceneError, missing_extra
from sandbox.output.frames import FloatArray, Frame
from sandbox.output.mesh.solids import Prop, props
from sandbox.output.mesh.surface import BodyParts, BodyShape, Surfaces
from sandbox.render import palette
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import ColorBy

_SAVED = 64
"""Frames that are kept in memory before they are written."""


def check_usd() -> None:
    """Raise SceneError where USD is not installed."""
    try:
        import pxr.UsdGeom  # noqa: F401
    except ImportError:
        raise SceneError(missing_extra("usd", "Pixar's usd-core", "usd")) from None


class UsdWriter:
    """Meshes, curves and points with samples of points and velocities; colliders with samples of where they are."""

    def __init__(self, path: Path, surfaces: Surfaces, appearance: Appearance, fps: float, by: ColorBy) -> None:
        """``fps`` are the pictures, and time codes, a second; ``by`` is what colours show."""
        from pxr import Usd, UsdGeom

        self._surfaces, self._fps, self._count = surfaces, fps, 0
        self._by_value = by is not ColorBy.BODY
        stage = self._stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        root = UsdGeom.Xform.Define(stage, "/scene")
        stage.SetDefaultPrim(root.GetPrim())
        UsdGeom.Scope.Define(stage, "/scene/bodies")
        names: set[str] = set()
        self._bodies = [
            _Body(stage, _free(names, parts.name), parts, self._by_value, surfaces.tears) for parts in surfaces.bodies
        ]
        self._props = [_Collider(stage, _free(names, prop.name), prop) for prop in props(appearance)]

    def write(self, frame: Frame) -> None:
        """Add a sample to everything that moves."""
        code = frame.time * self._fps
        for body, shape in zip(self._bodies, self._surfaces.at(frame), strict=True):
            body.write(code, shape)
        for prop in self._props:
            prop.write(code, frame.time)
        if self._count == 0:
            self._stage.SetStartTimeCode(code)
        # Last: a sample that was interrupted lies beyond the end.
        self._stage.SetEndTimeCode(code)
        self._count += 1
        if self._count % _SAVED == 0:
            self._stage.GetRootLayer().Save()

    def close(self) -> None:
        """Write the file."""
        self._stage.GetRootLayer().Save()
        self._stage = None


class _Body:
    """The prims of one body."""

    def __init__(self, stage: Any, name: str, parts: BodyParts, by_value: bool, tears: bool) -> None:
        from pxr import UsdGeom

        place = f"/scene/bodies/{name}"
        self._root = UsdGeom.Xform.Define(stage, place)
        self._by_value, self._tears, self._hidden = by_value, tears, False
        self._mesh = self._lines = self._dots = None
        self._shown: tuple[Any, Any] | None = None
        """Triangles and lines of the frame before."""
        prims: list[Any] = []
        if len(parts.triangles):
            self._mesh = UsdGeom.Mesh.Define(stage, f"{place}/surface")
            self._mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
            self._mesh.CreateDoubleSidedAttr(parts.two_sided)
            prims.append(self._mesh)
        if len(parts.lines):
            self._lines = UsdGeom.BasisCurves.Define(stage, f"{place}/lines")
            self._lines.CreateTypeAttr(UsdGeom.Tokens.linear)
            prims.append(self._lines)
        if len(parts.dots):
            self._dots = UsdGeom.Points.Define(stage, f"{place}/particles")
            self._dots.CreateWidthsAttr(_floats(2.0 * parts.dot_radius))
            prims.append(self._dots)
        for prim in prims:
            if not by_value:
                prim.CreateDisplayColorAttr(_vectors(palette.to_linear(parts.color)[None]))

    def write(self, code: float, shape: BodyShape) -> None:
        """Add a sample at a time code."""
        from pxr import UsdGeom

        shown = (shape.triangles, shape.lines)
        if self._shown is None or not all(map(np.array_equal, shown, self._shown)):
            self._connect(shape, code if self._tears else None)
            self._shown = shown
        ends, dots = shape.lines.ravel(), shape.dots
        for prim, points in ((self._mesh, slice(None)), (self._lines, ends), (self._dots, dots)):
            if prim is not None:
                colors = shape.colors[points] if self._by_value else None
                _place(prim, code, shape.vertices[points], shape.velocities[points], colors)
        if shape.present == self._hidden:
            token = UsdGeom.Tokens.inherited if shape.present else UsdGeom.Tokens.invisible
            self._root.CreateVisibilityAttr().Set(token, code)
            self._hidden = not shape.present

    def _connect(self, shape: BodyShape, code: float | None) -> None:
        """Say which triangles and lines there are, from a time code on, or at all times."""
        if self._mesh is not None:
            _set(self._mesh.CreateFaceVertexCountsAttr(), _ints(np.full(len(shape.triangles), 3)), code)
            _set(self._mesh.CreateFaceVertexIndicesAttr(), _ints(shape.triangles.ravel()), code)
        if self._lines is not None:
            _set(self._lines.CreateCurveVertexCountsAttr(), _ints(np.full(len(shape.lines), 2)), code)
            _set(self._lines.CreateWidthsAttr(), _floats(np.repeat(2.0 * shape.line_radius, 2)), code)


class _Collider:
    """The prims of one collider."""

    def __init__(self, stage: Any, name: str, prop: Prop) -> None:
        from pxr import Gf, UsdGeom

        place = f"/scene/colliders/{name}"
        UsdGeom.Scope.Define(stage, "/scene/colliders")
        self._prop = prop
        self._pose = UsdGeom.Xform.Define(stage, place).AddTransformOp()
        self._pose.Set(_matrix(prop.pose(0.0)))
        prims: list[Any] = []
        if len(prop.corners):
            mesh = UsdGeom.Mesh.Define(stage, f"{place}/surface")
            mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
            mesh.CreateDoubleSidedAttr(True)
            corners = prop.corners.reshape(-1, 3)
            mesh.CreatePointsAttr(_vectors(corners))
            mesh.CreateExtentAttr(_vectors(np.array([corners.min(axis=0), corners.max(axis=0)])))
            mesh.CreateFaceVertexCountsAttr(_ints(np.full(len(prop.corners), 3)))
            mesh.CreateFaceVertexIndicesAttr(_ints(np.arange(len(corners))))
            prims.append(mesh)
        for number, ((start, end), radius) in enumerate(zip(prop.ends, prop.radius, strict=True)):
            length = float(np.linalg.norm(end - start))
            turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, end - start if length else (0, 0, 1))))
            if length:
                prim = UsdGeom.Capsule.Define(stage, f"{place}/capsule_{number}")
                prim.CreateHeightAttr(length)
                prim.CreateAxisAttr(UsdGeom.Tokens.z)
            else:
                prim = UsdGeom.Sphere.Define(stage, f"{place}/sphere_{number}")
            prim.CreateRadiusAttr(float(radius))
            grown = np.array([radius, radius, radius + 0.5 * length])
            prim.CreateExtentAttr(_vectors(np.array([-grown, grown])))
            prim.AddTransformOp().Set(Gf.Matrix4d(turn, Gf.Vec3d(*map(float, (start + end) / 2))))
            prims.append(prim)
        for prim in prims:
            prim.CreateDisplayColorAttr(_vectors(prop.color[None]))

    def write(self, code: float, time: float) -> None:
        """Add a sample at a time code, for a time [s]."""
        if self._prop.motion is not None:
            self._pose.Set(_matrix(self._prop.pose(time)), code)


def _place(prim: Any, code: float, points: FloatArray, velocities: FloatArray, colors: FloatArray | None) -> None:
    """One sample of points, velocities and extent, and of colours where they show a value."""
    from pxr import UsdGeom

    prim.CreatePointsAttr().Set(_vectors(points), code)
    prim.CreateVelocitiesAttr().Set(_vectors(velocities), code)
    if len(points):
        prim.CreateExtentAttr().Set(_vectors(np.array([points.min(axis=0), points.max(axis=0)])), code)
    if colors is not None:
        shown = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        shown.Set(_vectors(palette.to_linear(colors)), code)


def _set(attribute: Any, value: Any, code: float | None) -> None:
    """A value at a time code, or at all times."""
    if code is None:
        attribute.Set(value)
    else:
        attribute.Set(value, code)


def _vectors(values: FloatArray) -> Any:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def _floats(values: FloatArray) -> Any:
    from pxr import Vt

    return Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def _ints(values: Any) -> Any:
    from pxr import Vt

    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, dtype=np.int32))


def _matrix(pose: FloatArray) -> Any:
    """USD's matrices take rows."""
    from pxr import Gf

    return Gf.Matrix4d(*map(float, pose.T.ravel()))


def _free(names: set[str], wanted: str) -> str:
    """A prim's name that no other has."""
    from pxr import Tf

    base = Tf.MakeValidIdentifier(wanted)
    name = next(n for n in [base, *(f"{base}_{k}" for k in range(2, len(names) + 3))] if n not in names)
    names.add(name)
    return str(name)
