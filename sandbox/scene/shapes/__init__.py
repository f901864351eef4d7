"""Pure NumPy generators: what particles, springs and surfaces a shape stands for, in its own frame.

The shape's centre is at the origin. Nothing here knows the material: springs carry their stiffness
over Young's modulus, particles their share of the mass. SciPy is imported by the functions that need it, as
it takes as long as the rest of the scene together.
"""

# Each module registers its generators.
from sandbox.scene.shapes import custom, lattices, lines, meshes, polygons, shells, trusses
from sandbox.scene.shapes.geometry import Geometry, generate, lengths

__all__ = ["Geometry", "custom", "generate", "lattices", "lengths", "lines", "meshes", "polygons", "shells", "trusses"]
