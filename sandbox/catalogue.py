"""What presets there are, and what physics each uses."""

from typing import Any

from sandbox.scene.assemble import Assembly, assemble
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
    scene = assembly.scene
    named = {
        "gravity": scene.gravity is not None and any(scene.gravity),
        "springs": assembly.spring_count > 0,
        "damping": bool(assembly.spring_damping.any()),
        "drag": scene.drag > 0.0,
        "pins": bool((assembly.inverse_masses == 0.0).any()),
    }
    kinds = sorted({collider.kind.replace("_", "-") for collider in scene.colliders})
    contact = [f"{kind} contact" for kind in kinds]
    if any(pair.friction > 0.0 for row in assembly.contacts for pair in row):
        contact.append("friction")
    if any(pair.restitution > 0.0 for row in assembly.contacts for pair in row):
        contact.append("restitution")
    return [f"{scene.dimension}D", *(name for name, there in named.items() if there), *contact]
