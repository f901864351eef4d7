"""The arrangement of springs for gathering: every half-edge once, wherever it is put."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbox import Simulation
from sandbox.forces import springs as springs_module
from sandbox.forces.spring_rows import END, arrange
from sandbox.forces.springs import SlicedSprings
from sandbox.scene.assemble import assemble
from tests.conftest import make_scene


def half_edges_of(rows, count: int, lanes: int) -> list[tuple[int, int, int]]:
    """(owner, neighbour, spring) of all half-edges: singly gathered ones and those of slices."""
    found = []
    for i in range(count):
        found += [(i, int(rows.neighbour[h]), int(rows.spring[h])) for h in range(rows.row[i], rows.sliced[i])]
    for index, start in enumerate(rows.slice_row):
        entry = int(start)
        while rows.offset[entry] != END:
            for lane in range(lanes):
                owner, spring = index * lanes + lane, int(rows.slice_spring[entry, lane])
                # Every lane's neighbour exists, also where there is no spring: it is read all the same.
                assert owner < count and 0 <= owner + rows.offset[entry] < count
                if spring >= 0:
                    found.append((owner, owner + int(rows.offset[entry]), spring))
            entry += 1
    return sorted(found)


@settings(max_examples=150, deadline=None)
@given(
    count=st.integers(2, 40),
    lanes=st.sampled_from([1, 4, 8]),
    pairs=st.lists(st.tuples(st.integers(0, 39), st.integers(0, 39)), max_size=120),
)
def test_every_half_edge_is_gathered_once(count, lanes, pairs):
    springs = np.array([(a % count, b % count) for a, b in pairs if a % count != b % count], np.int32).reshape(-1, 2)
    directions = [(springs[:, 0], springs[:, 1]), (springs[:, 1], springs[:, 0])]
    expected = sorted(
        (int(a), int(b), s) for one, other in directions for s, (a, b) in enumerate(zip(one, other, strict=True))
    )
    rows = arrange(springs, count, lanes)
    assert half_edges_of(rows, count, lanes) == expected
    owners = np.repeat(np.arange(count), np.diff(rows.row))
    assert sorted(zip(owners, rows.neighbour, rows.spring, strict=True)) == expected


def test_a_lattice_is_almost_all_slices():
    box = {"kind": "box", "size": [1.0] * 3, "cells": [16] * 3}
    assembly = assemble(make_scene(dimension=3, bodies=[{"name": "b", "shape": box, "material": {"stiffness": 1.0}}]))
    rows = arrange(assembly.springs, assembly.particle_count, 8)
    assert (rows.slice_spring >= 0).sum() > 0.98 * len(rows.neighbour)


@pytest.mark.parametrize("damping", [0.0, 20.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_slices_give_the_same_motion_as_single_gathering(simulate, monkeypatch, dimension, damping):
    cells = [40, 11] if dimension == 2 else [9, 6, 5]
    body = {
        "name": "block",
        "shape": {"kind": "box", "size": [0.1 * n for n in cells], "cells": cells},
        "angular_velocity": 2.0 if dimension == 2 else [1.0, 2.0, 3.0],
        "material": {"stiffness": 1e4, "damping": damping, "mass": 100.0},
        "pin": {"indices": [0, 5]},
    }
    scene = make_scene(
        dimension=dimension, gravity=[0, -9.81, 0][:dimension], solver={"precision": "f64"}, bodies=[body]
    )
    states = []
    for least, kind in ((0, SlicedSprings), (10**9, springs_module.Springs)):
        monkeypatch.setattr(springs_module, "_LEAST_SPRINGS", least)
        simulation: Simulation = simulate(scene)
        assert type(simulation.laws[-1]) is kind
        simulation.advance(0.1)
        states.append(np.concatenate([simulation.positions(), simulation.velocities()]))
    assert states[0] == pytest.approx(states[1], abs=1e-10)
    assert np.abs(states[0][: len(states[0]) // 2] - scene_start(scene)).max() > 1e-2


def scene_start(scene):
    return assemble(scene).positions
