"""What refining a lattice does to its stiffness: nothing in a homogeneous strain, in bending less and less."""

import numpy as np
import pytest

from benchmarks.refinement import Bar
from tests.conftest import make_scene

MODULUS = 2e5  # Pa


@pytest.mark.parametrize(("dimension", "cells"), [(2, 1), (2, 3), (2, 5), (3, 1), (3, 3)])
def test_a_pulled_bar_is_as_stiff_as_its_material_at_any_fineness(dimension, cells):
    assert Bar(dimension, cells).pulled() == pytest.approx(0.0, abs=1e-9)


def test_a_bent_bar_is_too_stiff_by_the_square_of_its_cells():
    """Of squares by 5 / (4 n^2): axial springs of the outermost rows lie further out than the mean of their cells."""
    for cells in (1, 2, 3, 6):
        assert Bar(2, cells).bent() == pytest.approx(1.25 / cells**2, rel=1e-6)
    coarse, fine = Bar(3, 2).bent(), Bar(3, 4).bent()
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.2) and 0.8 < 4.0 * coarse < 1.0


def test_the_engine_sags_as_the_matrix_says():
    """Damped to rest by implicit steps; beam theory is off by what the cells leave out, 1 / (1 + 5 / 16) - 1."""
    bar = Bar(2, 2)
    assert bar.settled() == pytest.approx(bar.sag(), rel=1e-4)
    assert bar.sag() / bar.sag_of_a_beam() == pytest.approx(1.0 / (1.0 + 1.25 / 4.0), rel=0.01)


@pytest.mark.parametrize("cells", [[3, 2], [6, 4], [4, 3, 2]])
def test_the_energy_of_a_homogeneous_strain_is_that_of_the_material(simulate, cells):
    """A bar of E, stretched by e and drawn in by nu e, holds E e^2 / 2 a volume."""
    dimension, strain = len(cells), 1e-5
    size = [0.1 * number for number in ([3, 2] if dimension == 2 else cells)]
    scene = make_scene(
        dimension=dimension,
        solver={"precision": "f64", "dt": 1e-4},
        bodies=[{"name": "bar", "shape": {"kind": "box", "size": size, "cells": cells},
                 "material": {"youngs_modulus": MODULUS, "damping_ratio": 0.0}}],
    )  # fmt: skip
    simulation = simulate(scene)
    x = simulation.positions()
    poisson = 1.0 / 3.0 if dimension == 2 else 0.25
    stretch = np.array([1.0 + strain, *([1.0 - poisson * strain] * (dimension - 1))])
    simulation.set_state(x * stretch, np.zeros_like(x))
    assert simulation.energy().elastic == pytest.approx(0.5 * MODULUS * strain**2 * np.prod(size), rel=1e-4)
