"""The numbers of camera and light, packed into one array that every kernel reads."""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render.camera import PinholeCamera
from sandbox.render.light import LightFrame
from sandbox.render.types import vec3

TILE = 16
"""Side of a tile of the picture [pixels]."""
BLOCK = 4
"""Side of a block of the shadow map, whose highest caster is kept [texels]."""
CELL = 16
"""Side of a cell of the shadow map, whose lowest and highest height are known when it is read [texels]."""
SAMPLE_X = (-0.125, 0.375, -0.375, 0.125)
SAMPLE_Y = (-0.375, -0.125, 0.125, 0.375)
"""Rotated grid of four samples, relative to the pixel's centre [pixels]."""
ROUND_BIT = 1 << 30
"""Set in the identity of a capsule or sphere; triangles count from 1, and 0 is what does not move."""

OPEN, SOLID = 1, 2
"""Bits of a body's look: a surface seen from both sides, and a collider that moves."""
MOVING, STILL = 1, 2
"""Bits of a tile of the shadow map near which something casts that moves, or that does not."""

EYE, RIGHT, UP, FORWARD, FOCAL, CENTER, NEAR = 0, 3, 6, 9, 12, 13, 15
LIGHT, LIGHT_U, LIGHT_V, LIGHT_ORIGIN, TEXELS, TOP, FADE = 18, 21, 24, 27, 30, 31, 32
LENGTH = 33


def view_constants(camera: PinholeCamera, light: LightFrame) -> NDArray[np.float32]:
    """Camera and light as the kernels read them, shape (LENGTH,)."""
    constants = np.zeros(LENGTH, dtype=np.float32)
    constants[EYE : EYE + 3] = camera.eye
    constants[RIGHT : RIGHT + 3] = camera.right
    constants[UP : UP + 3] = camera.up
    constants[FORWARD : FORWARD + 3] = camera.forward
    constants[FOCAL] = camera.focal
    constants[CENTER : CENTER + 2] = camera.center
    constants[NEAR] = 1e-4
    constants[LIGHT : LIGHT + 3] = light.direction
    constants[LIGHT_U : LIGHT_U + 3] = light.u_axis
    constants[LIGHT_V : LIGHT_V + 3] = light.v_axis
    constants[LIGHT_ORIGIN : LIGHT_ORIGIN + 3] = light.origin
    constants[TEXELS] = light.texels_per_metre
    constants[TOP] = light.top
    constants[FADE] = light.fade
    return constants


@ti.func
def at3(view: ti.template(), start: ti.template()):
    """Three numbers of `view` as a vector."""
    return vec3(view[start], view[start + 1], view[start + 2])


@ti.func
def project(view: ti.template(), p):
    """Pixel x, pixel y, and inverse depth [1/m]; inverse depth 0 where p is not in front of the camera."""
    relative = p - at3(view, EYE)
    depth = relative.dot(at3(view, FORWARD))
    inverse = 0.0
    if depth > view[NEAR]:
        inverse = 1.0 / depth
    x = view[CENTER] + view[FOCAL] * relative.dot(at3(view, RIGHT)) * inverse
    y = view[CENTER + 1] - view[FOCAL] * relative.dot(at3(view, UP)) * inverse
    return vec3(x, y, inverse)


@ti.func
def ray(view: ti.template(), x, y):
    """Direction through the picture at (x, y), of length 1 along the axis: eye + depth * ray is the point seen."""
    scale = 1.0 / view[FOCAL]
    across = (x - view[CENTER]) * scale
    down = (y - view[CENTER + 1]) * scale
    return at3(view, FORWARD) + at3(view, RIGHT) * across - at3(view, UP) * down


@ti.func
def to_light(view: ti.template(), p):
    """Texel u, texel v, and height w toward the light [m] of a point."""
    relative = p - at3(view, LIGHT_ORIGIN)
    scale = view[TEXELS]
    return vec3(
        relative.dot(at3(view, LIGHT_U)) * scale,
        relative.dot(at3(view, LIGHT_V)) * scale,
        relative.dot(at3(view, LIGHT)),
    )


@ti.func
def light_slope(view: ti.template(), normal):
    """Change of height w over a texel along u and v on a plane [m], and its cosine to the light."""
    cosine = normal.dot(at3(view, LIGHT))
    steep = -1.0 / (ti.max(cosine, 0.12) * view[TEXELS])
    return vec3(normal.dot(at3(view, LIGHT_U)) * steep, normal.dot(at3(view, LIGHT_V)) * steep, cosine)
