"""Array types of the rendering kernels."""

import taichi as ti

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)
vec4 = ti.types.vector(4, ti.f32)

# Arrays rather than fields: kernels over them do not depend on sizes, so that one compiled kernel (and one entry of
# the offline cache) serves every scene and picture size, and freeing them leaves the simulation's kernels alone.
Floats = ti.types.ndarray(dtype=ti.f32, ndim=1)
Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)
Ints2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
Points = ti.types.ndarray(dtype=vec3, ndim=1)
Picture3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
Samples = ti.types.ndarray(dtype=ti.u64, ndim=3)
SampleDepths = ti.types.ndarray(dtype=ti.f32, ndim=3)
Image2 = ti.types.ndarray(dtype=vec2, ndim=2)
Image3 = ti.types.ndarray(dtype=vec3, ndim=2)
Image4 = ti.types.ndarray(dtype=vec4, ndim=2)
Keys = ti.types.ndarray(dtype=ti.i32, ndim=3)
Points2 = ti.types.ndarray(dtype=vec2, ndim=1)
Rows = ti.types.ndarray(dtype=ti.f32, ndim=2)
Image = ti.types.ndarray(dtype=ti.f32, ndim=3)
Background = ti.types.ndarray(dtype=ti.u32, ndim=2)
