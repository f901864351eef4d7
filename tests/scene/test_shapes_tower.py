"""Towers stand: how many members, how heavy, and that nothing of them moves freely."""

import numpy as np
import pytest

from tests.scene.test_shapes import shape, stiffness_matrix

TOWERS = [(dimension, bays, top) for dimension in (2, 3) for bays in (1, 2, 3, 4) for top in (None, 0.3)]


@pytest.mark.parametrize(("dimension", "bays", "top"), TOWERS)
def test_tower_is_rigid(dimension: int, bays: int, top: float | None) -> None:
    tower = shape(dimension, kind="tower", levels=2, bays=bays, height=2.0, width=1.0, top_width=top)
    matrix = stiffness_matrix(tower)
    free = np.repeat(tower.points[:, 1] > 1e-9, dimension)
    standing = np.linalg.eigvalsh(matrix[np.ix_(free, free)])
    assert standing[0] > 1e-5 * standing[-1]
    # Off the ground only the motions of a rigid body are free.
    flying = np.linalg.eigvalsh(matrix)
    assert (flying < 1e-9 * flying[-1]).sum() == dimension * (dimension + 1) // 2


@pytest.mark.parametrize("bays", [1, 2, 5])
@pytest.mark.parametrize("levels", [1, 4])
def test_tower_member_count(levels: int, bays: int) -> None:
    flat = shape(2, kind="tower", levels=levels, bays=bays, height=2.0, width=1.0)
    assert len(flat.points) == (levels + 1) * (bays + 1)
    assert len(flat.springs) == levels * (bays + 1 + 2 * bays) + (levels + 1) * bays
    square = shape(3, kind="tower", levels=levels, bays=bays, height=2.0, width=1.0)
    assert len(square.points) == (levels + 1) * 4 * bays
    assert len(square.springs) == levels * 12 * bays + (levels + 1) * (4 * bays + 6 * bays - 4)


def test_tower_stands_on_its_foot_and_narrows() -> None:
    tower = shape(3, kind="tower", levels=4, bays=3, height=3.0, width=1.0, top_width=0.5)
    low, high = tower.points.min(axis=0), tower.points.max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.5, 0.0, -0.5], [0.5, 3.0, 0.5]])
    for height, width in ((0.0, 1.0), (1.5, 0.75), (3.0, 0.5)):
        level = tower.points[np.abs(tower.points[:, 1] - height) < 1e-9]
        np.testing.assert_allclose(np.ptp(level[:, [0, 2]], axis=0), width)
        # Every node lies on the square's rim.
        np.testing.assert_allclose(np.abs(level[:, [0, 2]]).max(axis=1), 0.5 * width)


def test_tower_members_are_bars() -> None:
    tower = shape(3, kind="tower", levels=1, bays=1, height=1.0, width=1.0, thickness=0.1)
    assert tower.spring_scale is not None
    np.testing.assert_allclose(tower.spring_scale, np.pi / 4.0 * 0.01 / tower.rest_lengths)
    # 4 legs, 8 horizontals, 8 crosses and 4 diagonals in plan.
    assert tower.volume == pytest.approx(np.pi / 4.0 * 0.01 * (12.0 + 12.0 * np.sqrt(2.0)))
    np.testing.assert_allclose(tower.mass_share, 1.0 / 8.0)
    assert (tower.capsules == tower.springs).all() and tower.capsule_radius == 0.05
    flat = shape(2, kind="tower", levels=1, bays=1, height=1.0, width=1.0, thickness=0.1)
    np.testing.assert_allclose(flat.spring_scale, 0.1 / flat.rest_lengths)
    assert flat.volume == pytest.approx(0.1 * (4.0 + 2.0 * np.sqrt(2.0)))
