"""Colours: nothing of one colour has to do with each other, few colours, alike everywhere."""

import itertools

import numpy as np
import pytest

from sandbox.integrators.colouring import ColourLists, colour_edges, colour_particles


def lattice(side: int) -> tuple[int, np.ndarray]:
    """Cube of particles, each tied to all 26 around it."""
    number = np.arange(side**3).reshape((side,) * 3)
    pairs = []
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step > (0, 0, 0):
            here = tuple(slice(max(0, -d), side - max(0, d)) for d in step)
            there = tuple(slice(max(0, d), side + min(0, d)) for d in step)
            pairs.append(np.stack([number[here].ravel(), number[there].ravel()], axis=1))
    return side**3, np.concatenate(pairs)


def tangle() -> tuple[int, np.ndarray]:
    pairs = np.random.default_rng(0).integers(0, 300, (2000, 2))
    return 300, pairs[pairs[:, 0] != pairs[:, 1]]


GRAPHS = {
    "lattice": lattice(7),
    "tangle, some twice": tangle(),
    "odd ring": (101, np.stack([np.arange(101), (np.arange(101) + 1) % 101], axis=1)),
    "hub": (60, np.stack([np.zeros(59, dtype=int), np.arange(1, 60)], axis=1)),
    "nothing": (3, np.zeros((0, 2), dtype=int)),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_no_two_particles_of_a_colour_are_tied(name):
    count, pairs = GRAPHS[name]
    colours, colour = colour_particles(count, pairs)
    assert colour.shape == (count,) and set(colour.tolist()) == set(range(colours))
    assert (colour[pairs[:, 0]] != colour[pairs[:, 1]]).all()
    assert np.array_equal(colour, colour_particles(count, pairs)[1])


@pytest.mark.parametrize("name", GRAPHS)
def test_no_two_springs_of_a_colour_share_a_particle(name):
    count, pairs = GRAPHS[name]
    colours, colour = colour_edges(count, pairs)
    assert colour.shape == (len(pairs),) and set(colour.tolist()) == set(range(colours))
    ends = np.concatenate([pairs[:, 0], pairs[:, 1]]) * (colours + 1) + np.tile(colour, 2)
    assert len(np.unique(ends)) == len(ends)


def test_a_lattice_takes_the_fewest_colours_and_all_are_alike():
    count, pairs = GRAPHS["lattice"]
    colours, _ = colour_particles(count, pairs)
    assert colours == 8
    edge_colours, edge_colour = colour_edges(count, pairs)
    assert edge_colours <= 28  # 26 springs meet at a particle
    sizes = np.bincount(edge_colour)
    assert sizes.min() > 0.8 * sizes.mean()


def test_lists_hold_every_member_once_and_leave_out_whom_they_should():
    count, pairs = GRAPHS["tangle, some twice"]
    colours, colour = colour_particles(count, pairs)
    lists = ColourLists.of(colours, colour)
    assert sorted(lists.member.tolist()) == list(range(count))
    for k in range(colours):
        assert (colour[lists.member[lists.first[k] : lists.first[k + 1]]] == k).all()
    held = np.arange(count) % 3 == 0
    rest = lists.without(held)
    assert sorted(rest.member.tolist()) == np.nonzero(~held)[0].tolist()
    for k in range(colours):
        assert (colour[rest.member[rest.first[k] : rest.first[k + 1]]] == k).all()
