"""Errors of known displacements, and what is compared where trajectories are not."""

from dataclasses import replace

import numpy as np
import pytest

from sandbox.scene.assemble import assemble
from sandbox.trade import norms
from sandbox.trade.norms import Scale
from sandbox.trade.record import Record
from tests.conftest import make_scene

FRAMES = 40


@pytest.fixture(scope="module")
def scale() -> Scale:
    """Of a box of 0.4 m and a rope of 2 m whose first point is held."""
    box = {"name": "box", "shape": {"kind": "box", "size": [0.4, 0.2], "cells": [2, 1]}}
    rope = {"name": "rope", "shape": {"kind": "rope", "start": [1.0, 0.0], "end": [3.0, 0.0], "segments": 3}}
    bodies = [
        {**box, "material": {"stiffness": 1.0}},
        {**rope, "material": {"stiffness": 1.0}, "pin": {"indices": [0]}},
    ]
    return Scale.of(assemble(make_scene(dimension=2, bodies=bodies)))


@pytest.fixture(scope="module")
def reference(scale) -> Record:
    """A record that moves and dies down."""
    random = np.random.default_rng(1)
    count = len(scale.sizes)
    kinetic = 8.0 * 0.5 ** np.arange(FRAMES + 1)
    energies = np.stack([kinetic, 1.0 + 0.0 * kinetic, 5.0 - kinetic, 0.0 * kinetic], axis=1)
    volumes = np.stack([np.full(FRAMES + 1, 0.08), np.full(FRAMES + 1, np.nan)], axis=1)
    return Record(
        samples=np.array([20, 40]),
        positions=random.standard_normal((2, count, 2)),
        energies=energies,
        centres=random.standard_normal((FRAMES + 1, 2, 2)),
        volumes=volumes,
    )


def test_sizes_and_what_moves(scale):
    assert scale.sizes.tolist() == [0.4] * 6 + [2.0] * 4
    assert scale.moves.tolist() == [True] * 6 + [False] + [True] * 3
    assert scale.body_sizes.tolist() == [0.4, 2.0]


def test_a_displacement_counts_by_its_body(scale, reference):
    moved = reference.positions.copy()
    moved[1, scale.body == 0] += [0.0, 0.04]  # a tenth of the box
    errors = norms.errors_over_time(scale, replace(reference, positions=moved), reference)
    assert errors == pytest.approx([0.0, np.sqrt(6 * 0.1**2 / 9)], abs=1e-15)
    assert norms.rms(errors) == pytest.approx(np.sqrt(0.5 * 6 * 0.1**2 / 9))


def test_references_agree_up_to_the_first_difference():
    assert norms.agreeing(np.array([1e-5, 1e-4, 1e-2, 1e-6])) == 2
    assert norms.agreeing(np.array([1e-5, np.nan])) == 1
    assert norms.agreeing(np.array([1e-5])) == 1
    assert norms.agreeing(np.array([1.0])) == 0


def test_energy_error(reference):
    other = reference.energies.copy()
    other[5, 1] += 0.8
    run = replace(reference, energies=other)
    assert norms.energy_at_play(reference) == pytest.approx(8.0)
    assert norms.energy_error(run, reference, 40) == pytest.approx(0.1)
    assert norms.energy_error(run, reference, 4) == 0.0


def test_a_turned_body_has_the_same_shape_and_a_mirrored_one_has_not(scale, reference):
    turn = np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
    turned = replace(reference, positions=reference.positions @ turn + [3.0, -1.0])
    assert norms.compare(scale, turned, reference, 0, 0.1).shape < 1e-12
    mirrored = replace(reference, positions=reference.positions * [1.0, -1.0])
    assert norms.compare(scale, mirrored, reference, 0, 0.1).shape > 0.1


def test_statistics(scale, reference):
    other = replace(
        reference,
        centres=reference.centres + np.array([[0.04, 0.0], [0.0, 0.2]]),
        volumes=1.05 * reference.volumes,
        energies=reference.energies + np.array([0.0, 0.8, 0.0, 0.0]),
    )
    found = norms.compare(scale, other, reference, 10, 0.1)
    assert found.centre == pytest.approx(0.1)
    assert found.volume == pytest.approx(0.05)
    assert found.energy == pytest.approx(0.1)
    assert found.settling == 0.0


def test_settling(reference):
    # 8 J fall below a hundredth of it after 7 halvings.
    assert norms.settling_time(reference, 0.1) == pytest.approx(0.7)
    lively = replace(reference, energies=np.ones((FRAMES + 1, 4)))
    assert np.isnan(norms.settling_time(lively, 0.1))
