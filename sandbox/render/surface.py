"""What surfaces look like: the lights, the background, and the jelly that bodies are made of."""

import taichi as ti

from sandbox.render.types import vec3

KEY = (1.02, 0.98, 0.92)
SKY = (0.46, 0.50, 0.56)
BOUNCE = (0.34, 0.32, 0.30)
ZENITH = (0.42, 0.52, 0.66)
HORIZON = (0.74, 0.775, 0.815)
WRAP = 0.35
SEEP_BELOW, SEEP_ABOVE = 0.05, 0.35
"""Cosine to the light below which a body's own shadow has no effect, and above which all of it."""


@ti.func
def constant3(color: ti.template()):
    """A colour of this module as a vector."""
    return vec3(color[0], color[1], color[2])


@ti.func
def smoothstep(low, high, x):
    """0 below `low`, 1 above `high`, smooth between."""
    t = ti.min(ti.max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@ti.func
def background(direction):
    """Sky seen along a unit direction."""
    t = smoothstep(-0.05, 0.55, direction.y)
    return constant3(HORIZON) * (1.0 - t) + constant3(ZENITH) * t


@ti.func
def ambient_light(normal):
    """Light of sky and ground on a surface."""
    up = 0.5 + 0.5 * normal.y
    return constant3(SKY) * up + constant3(BOUNCE) * (1.0 - up)


@ti.func
def power8(x):
    """x to the 8th."""
    x2 = x * x
    x4 = x2 * x2
    return x4 * x4


@ti.func
def jelly(albedo, normal, to_eye, light, lit, occlusion):
    """Light that leaves a soft body: wrapped diffuse, light through thin parts, two highlights, a Fresnel rim."""
    ndl, ndv = normal.dot(light), ti.max(normal.dot(to_eye), 0.0)
    # Past the terminator light still seeps through the body, where its own shadow says nothing.
    seep = 1.0 - smoothstep(SEEP_BELOW, SEEP_ABOVE, ndl)
    reached = lit + (1.0 - lit) * seep
    wrapped = ti.max((ndl + WRAP) / (1.0 + WRAP), 0.0)
    key = constant3(KEY)
    diffuse = albedo * key * (wrapped * reached)
    through = ti.max(-to_eye.dot((light + normal * 0.35).normalized()), 0.0)
    diffuse += albedo * key * (0.35 * through * through * through)
    diffuse += albedo * ambient_light(normal) * occlusion
    half = (light + to_eye).normalized()
    sharp = power8(power8(ti.max(normal.dot(half), 0.0)))
    mirror = normal * (2.0 * normal.dot(to_eye)) - to_eye
    grazing = 1.0 - ndv
    fresnel = 0.035 + 0.34 * grazing * grazing * grazing * grazing
    # A wide soft box above: gives bevels and wrinkles their sheen.
    sheen = smoothstep(0.35, 0.95, mirror.y)
    # What lies below mirrors darker: the body's own shade, mostly.
    reflected = background(mirror) * (0.2 + 0.55 * smoothstep(-0.3, 0.3, mirror.y)) + vec3(0.9, 0.9, 0.9) * sheen
    return diffuse + key * (0.45 * sharp * lit) + reflected * (fresnel * occlusion)


@ti.func
def solid(albedo, normal, along, light):
    """Ambient light and unshadowed key light that a collider sends back along a unit direction from the eye."""
    ambient = albedo * ambient_light(normal)
    key = albedo * constant3(KEY) * ti.max(normal.dot(light), 0.0)
    cosine = ti.max(-normal.dot(along), 0.0)
    grazing = (1.0 - cosine) * (1.0 - cosine)
    ambient += background(along + normal * (2.0 * cosine)) * (0.03 + 0.25 * grazing * grazing)
    return ambient, key
