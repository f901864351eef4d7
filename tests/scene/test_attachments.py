"""What holds bodies to each other and to colliders, before and while they move."""

import numpy as np
import pytest

from sandbox import SceneError
from sandbox.scene.assemble import assemble
from tests.conftest import make_scene


def rope(name: str, y: float, **more):
    shape = {"kind": "rope", "from": [0.0, y], "to": [1.0, y], "segments": 4}
    return {"name": name, "shape": shape, "material": {"stiffness": 100.0, "mass": 0.5}, **more}


def scene_of(*attachments, colliders=(), **more):
    bodies = [rope("low", 0.0), rope("high", 0.5), rope("far", 3.0)]
    return make_scene(dimension=2, bodies=bodies, attachments=list(attachments), colliders=list(colliders), **more)


def test_each_attached_particle_gets_a_spring_to_the_nearest_of_the_other_body():
    held = {"body": "high", "indices": [0, 4], "to": "low", "stiffness": 50.0, "damping": 2.0}
    assembly = assemble(scene_of(held))
    springs = assembly.spring_set.chosen(assembly.spring_set.body == 3)
    assert springs.ends.tolist() == [[5, 0], [9, 4]]
    assert springs.rest_lengths == pytest.approx([0.5, 0.5])
    assert springs.stiffness.tolist() == [50.0, 50.0]
    assert springs.damping.tolist() == [2.0, 2.0]
    assert assembly.families.tolist() == [0, 0, 2]


def test_stiffness_is_by_default_that_of_the_bodies_springs():
    assembly = assemble(scene_of({"body": "high", "indices": [0], "to": "low"}))
    assert assembly.spring_set.stiffness[-1] == 100.0


def test_families_join_through_others():
    chain = [{"body": "high", "indices": [0], "to": "low"}, {"body": "far", "indices": [0], "to": "high"}]
    assert assemble(scene_of(*chain)).families.tolist() == [0, 0, 0]


def test_a_region_chooses_by_place_and_a_still_collider_pins():
    post = {"name": "post", "kind": "sphere", "position": [0.0, 5.0], "radius": 0.1}
    held = {"body": "high", "region": {"min": [0.6, 0.0], "max": [2.0, 1.0]}, "to": "post"}
    assembly = assemble(scene_of(held, colliders=[post]))
    assert np.nonzero(assembly.inverse_masses == 0.0)[0].tolist() == [8, 9]
    assert len(assembly.carried.particles) == 0


def test_carried_particles_keep_their_place_in_the_frame_of_the_collider(simulate):
    hand = {
        "name": "hand", "kind": "box", "position": [0.0, 0.7], "size": [0.2, 0.1], "rotation": 30.0,
        "motion": [{"time": 0.0}, {"time": 1.0, "position": [1.0, 1.0], "rotation": 120.0}],
    }  # fmt: skip
    held = {"body": "high", "indices": [0, 1], "to": "hand"}
    scene = scene_of(held, colliders=[hand], solver={"dt": 1e-3, "precision": "f64"})
    simulation = simulate(scene)
    arms = simulation.positions()[[5, 6]] - [0.0, 0.7]
    simulation.advance(1.2)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # from 30 to 120 degrees
    assert simulation.positions()[[5, 6]] == pytest.approx(arms @ turn.T + [1.0, 1.0], abs=1e-9)
    assert simulation.velocities()[[5, 6]] == pytest.approx(np.zeros((2, 2)), abs=1e-9)


def test_two_bodies_hang_together_until_the_spring_between_them_tears(simulate):
    def hang(**more):
        held = {"body": "high", "indices": [2], "to": "low", "stiffness": 200.0, "damping": 1.0, **more}
        scene = make_scene(
            dimension=2,
            gravity=[0.0, -9.81],
            drag=6.0,
            solver={"dt": 1e-3, "precision": "f64"},
            bodies=[rope("high", 0.0, pin={"indices": [0, 4]}), rope("low", -0.3)],
            attachments=[{**held, "body": "low", "to": "high"}],
        )
        return simulate(scene)

    held, torn = hang(), hang(break_strain=0.05)
    for simulation in (held, torn):
        simulation.advance(12.0)
    # A weight of 0.5 kg on a spring of 200 N/m and 0.3 m.
    gap = held.positions()[2] - held.positions()[7]
    assert np.linalg.norm(gap) == pytest.approx(0.3 + 0.5 * 9.81 / 200.0, rel=2e-3)
    assert torn.measure().torn == 1
    assert torn.positions()[5:, 1].max() < -10.0


@pytest.mark.parametrize(
    ("attachment", "message"),
    [
        ({"body": "none", "indices": [0], "to": "low"}, "attachments[0].body: there is no body 'none'"),
        ({"body": "low", "indices": [0], "to": "none"}, "attachments[0].to: there is no body or collider 'none'"),
        ({"body": "low", "indices": [0], "to": "low"}, "attachments[0].to: is the attached body itself"),
        ({"body": "low", "indices": [7], "to": "high"}, "attachments[0].indices[0]: there is no particle 7"),
        ({"body": "low", "region": {"min": [5, 5], "max": [6, 6]}, "to": "high"}, "attachments[0].region: holds no"),
        ({"body": "low", "to": "high"}, "attachments[0]: give indices or region"),
    ],
)
def test_mistakes_are_named(attachment, message):
    with pytest.raises(SceneError) as caught:
        assemble(scene_of(attachment))
    assert message in str(caught.value)
