"""What presets there are, and what physics each uses."""

from typing import Any

import numpy as np

from sandbox.scene.assemble import Assembly, assemble, combine_bodies
from sandbox.scene.load import load_scene, preset_paths


def catalogue() -> list[dict[str, Any]]:
    """One row a preset: name, title, dimension, particles, springs, physics."""
    rows = []
    for name in preset_paths():
        assembly = assemble(load_scene(name))
        rows.append(
            {
                "name": name,
                "title": assembly.scene.title,
                "dimension": assembly.dimension,
                "particles": assembly.particle_count,
                "springs": assembly.spring_count,
                "physics": physics(assembly),
            }
        )
    return rows


def physics(assembly: Assembly) -> list[str]:
    """The laws, constraints and contacts that a scene names, in words."""
    scene, springs = assembly.scene, assembly.spring_set
    gauges = [body.pressure for body in scene.bodies if body.pressure is not None]
    named = {
        "gravity": scene.gravity is not None and any(scene.gravity),
        "springs": assembly.spring_count > 0,
        "damping": bool(springs.damping.any()),
        "tension-only": bool(springs.tension_only.any()),
        "plasticity": bool(np.isfinite(springs.yield_strain).any()),
        "tearing": springs.tears,
        "gas": bool(gauges),
        "leak": any(pressure.leak > 0.0 for pressure in gauges),
        "wind": scene.wind is not None,
        "gusts": scene.wind is not None and scene.wind.gust is not None,
        "vortex": scene.wind is not None and bool(scene.wind.vortices),
        "drag": scene.drag > 0.0,
        "pins": bool((assembly.inverse_masses == 0.0).any()),
        "attachments": bool(scene.attachments),
        "self-contact": scene.contact.enabled and any(body.self_contact for body in scene.bodies),
        "contact between bodies": scene.contact.enabled and sum(body.has_radius for body in scene.bodies) > 1,
    }
    done = sorted({action.kind for action in scene.actions})
    return [f"{scene.dimension}D", *(name for name, there in named.items() if there), *done, *_collisions(assembly)]


def _collisions(assembly: Assembly) -> list[str]:
    scene = assembly.scene
    kinds = sorted({collider.kind.replace("_", "-") for collider in scene.colliders})
    collisions = [f"{kind} contact" for kind in kinds]
    if any(collider.motion for collider in scene.colliders):
        collisions.append("moving colliders")
    restitution, friction = combine_bodies([body.material for body in scene.bodies])
    pairs = [pair for row in assembly.contacts for pair in row]
    if any(pair.friction > 0.0 for pair in pairs) or (assembly.meets_particles and friction.any()):
        collisions.append("friction")
    if any(pair.restitution > 0.0 for pair in pairs) or (assembly.meets_particles and restitution.any()):
        collisions.append("restitution")
    return collisions
