"""Solid things that particles meet: swept, so that no speed carries a particle through.

Each collider finds where the straight path of a particle within a substep enters it; the particle
goes there, its velocity is treated by the surface, and it spends the rest of the substep at the new
velocity. A particle that starts inside is put onto the closest surface first.
"""

from sandbox.contact.colliders.build import Colliders, build_colliders

__all__ = ["Colliders", "build_colliders"]
