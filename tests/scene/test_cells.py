"""What is seen of bodies that have opened: closed surfaces of what is left, of the whole volume."""

import numpy as np
import pytest

from sandbox.scene.assemble import assemble
from sandbox.scene.cells import gap_points
from sandbox.scene.shapes.shells import icosphere
from sandbox.scene.surfaces import edge_springs, enclosed_volume
from sandbox.scene.topology import directed_edges
from tests.conftest import make_scene

MATERIAL = {"youngs_modulus": 1e5, "break_strain": 0.5}


def body(shape, dimension=3, material=MATERIAL, **scene):
    """The assembly of one body around the origin."""
    return assemble(
        make_scene(dimension=dimension, bodies=[{"name": "body", "shape": shape, "material": material}], **scene)
    )


def box(cells=(5, 4, 3), **more):
    return {"kind": "box", "size": [0.1 * n for n in cells], "cells": cells, **more}


def crossing(assembly, normal, offset=0.0):
    """Marks of the springs that a plane parts, and which particles lie in front of it."""
    front = assembly.positions @ np.asarray(normal, dtype=float) > offset
    ends = assembly.spring_set.ends
    return (front[ends[:, 0]] != front[ends[:, 1]]).astype(np.int32), front


def seen(assembly, torn):
    """Points as drawn, and the elements of triangles (2D: the outline) that are seen."""
    look = assembly.appearance
    shown = look.shown(torn)
    elements = look.outline[shown.outline] if look.dimension == 2 else look.triangles[shown.triangles]
    return look.drawn_points(assembly.positions, torn), elements


def is_closed(elements):
    """True where every edge (2D: point) is passed once in either direction, or as often in one as in the other."""
    if elements.shape[1] == 2:
        return np.array_equal(np.sort(elements[:, 0]), np.sort(elements[:, 1]))
    edges = directed_edges(elements)
    return sorted(map(tuple, edges.tolist())) == sorted(map(tuple, edges[:, ::-1].tolist()))


def area(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@pytest.mark.parametrize("bracing", ["none", "face", "body"])
def test_a_cut_box_becomes_two_closed_boxes(bracing):
    material = {"stiffness": 1e3, "break_strain": 0.5}
    assembly = body(box(bracing=bracing), material=material)
    torn, front = crossing(assembly, [1, 0, 0])
    points, triangles = seen(assembly, torn)
    _, uses = np.unique(np.sort(directed_edges(triangles), axis=1), axis=0, return_counts=True)
    assert np.all(uses == 2) and is_closed(triangles)
    # No triangle joins the halves.
    assert np.all(front[triangles] == front[triangles[:, :1]])
    # The layer that the cut passes is shared: nothing is lost but what is rounded at the corners of the cut.
    assert enclosed_volume(triangles, points) == pytest.approx(0.5 * 0.4 * 0.3, rel=0.01)
    assert area(points, triangles) == pytest.approx(2 * (0.2 + 0.15 + 0.12) + 2 * 0.12, rel=0.01)
    # Without that it is a layer less.
    assert enclosed_volume(triangles, assembly.positions) == pytest.approx(0.4 * 0.4 * 0.3)


@pytest.mark.parametrize("shape", [box((8, 8, 8)), {"kind": "ball", "radius": 0.4, "cells": 9}])
def test_an_oblique_cut_leaves_closed_surfaces(shape):
    assembly = body(shape)
    torn, front = crossing(assembly, [0.3, 1.0, 0.2], 0.013)
    points, triangles = seen(assembly, torn)
    whole = enclosed_volume(assembly.appearance.triangles, assembly.positions)
    assert is_closed(triangles) and np.all(front[triangles] == front[triangles[:, :1]])
    left = enclosed_volume(triangles, assembly.positions)
    assert left < 0.85 * whole and 0.92 * whole < enclosed_volume(triangles, points) < 1.02 * whole


@pytest.mark.parametrize(
    "shape",
    [
        {"kind": "box", "size": [0.9, 0.8], "cells": [9, 8]},
        {"kind": "ball", "radius": 0.4, "cells": 10},
        {"kind": "polygon", "points": [[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]], "spacing": 0.1},
    ],
)
def test_the_outline_of_a_flat_body_follows_the_cut(shape):
    assembly = body(shape, 2)
    torn, front = crossing(assembly, [1.0, 0.25], 0.02)
    look = assembly.appearance
    points, outline = seen(assembly, torn)
    filled = look.triangles[look.shown(torn).triangles]
    assert is_closed(outline) and np.all(front[outline[:, 0]] == front[outline[:, 1]])
    assert np.all(front[filled] == front[filled[:, :1]])
    whole = enclosed_volume(look.outline[look.shown().outline], assembly.positions)
    assert enclosed_volume(outline, points) == pytest.approx(whole, rel=0.06)
    # The outline goes round what is filled.
    a, b, c = (points[filled[:, k]] for k in range(3))
    fill = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum()
    assert fill == pytest.approx(enclosed_volume(outline, points))


def test_nothing_is_inside_of_what_has_not_torn():
    for shape, dimension in ((box(), 3), ({"kind": "box", "size": [1, 1], "cells": [4, 4]}, 2)):
        tears, plain = (body(shape, dimension, {**MATERIAL, "break_strain": b}) for b in (0.5, None))
        assert tears.appearance.tears and not plain.appearance.tears
        for torn in (None, np.zeros(tears.spring_count, dtype=np.int32)):
            shown = tears.appearance.shown(torn)
            for name, mask in zip(("triangles", "outline", "capsules"), shown, strict=True):
                kept = getattr(plain.appearance, name)
                assert np.array_equal(getattr(tears.appearance, name)[mask], kept) and np.all(mask[: len(kept)])
            assert np.array_equal(tears.appearance.drawn_points(tears.positions, torn), tears.positions)
        assert all(mask.all() for mask in plain.appearance.shown(None))


def test_a_cell_holds_until_a_corner_may_come_off():
    assembly = body(box((1, 1, 1)))
    cells = assembly.appearance.cells
    assert len(cells.limit) == 1
    of_corner = np.flatnonzero((assembly.spring_set.ends == 0).any(axis=1))
    torn = np.zeros(assembly.spring_count, dtype=np.int32)
    torn[of_corner[1:]] = 1
    assert not cells.broken(torn)[0] and np.all(assembly.appearance.shown(torn).triangles)
    torn[of_corner[0]] = 1
    assert cells.broken(torn)[0] and not np.any(assembly.appearance.shown(torn).triangles)


@pytest.mark.parametrize(
    ("shape", "dimension"),
    [
        ({"kind": "sheet", "size": [1.0, 1.0], "cells": [6, 5]}, 3),
        ({"kind": "shell", "radius": 0.5, "subdivisions": 2}, 3),
        ({"kind": "ring", "radius": 0.5, "segments": 12}, 2),
        ({"kind": "rope", "from": [0, 0], "to": [1, 0], "segments": 9}, 2),
    ],
)
def test_of_what_is_thin_vanishes_what_hangs_on_torn_springs(shape, dimension):
    assembly = body(shape, dimension)
    look = assembly.appearance
    torn = (np.random.default_rng(1).random(assembly.spring_count) < 0.2).astype(np.int32)
    shown = look.shown(torn)
    for elements, mask in (
        (look.triangles, shown.triangles),
        (look.outline, shown.outline),
        (look.capsules, shown.capsules),
    ):
        springs = edge_springs(elements, assembly.spring_set.ends)
        gone = np.any((springs >= 0) & (torn[springs] != 0), axis=1)
        assert np.array_equal(mask, ~gone)
    assert np.any(torn) and np.array_equal(look.drawn_points(assembly.positions, torn), assembly.positions)


def test_a_carried_surface_tears_where_its_cells_do(tmp_path):
    corners, triangles = icosphere(2)
    path = tmp_path / "ball.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    path.write_text("\n".join(lines))
    assembly = body({"kind": "mesh", "file": str(path), "fill": "lattice", "cells": 8})
    look = assembly.appearance
    outer = look.triangles[: len(triangles)]
    assert np.all(outer >= look.particle_count) and np.all(look.triangles[len(triangles) :] < look.particle_count)
    torn, front = crossing(assembly, [1.0, 0.0, 0.0], 0.1)
    shown = look.shown(torn).triangles
    points = look.drawn_points(assembly.positions, torn)
    middle = points[outer].mean(axis=1)[:, 0]
    near = np.abs(middle - 0.1) < 0.2
    assert not np.any(shown[: len(triangles)][np.abs(middle - 0.1) < 0.02])
    assert np.all(shown[: len(triangles)][np.abs(middle - 0.1) > 0.8]) and np.any(near)
    caps = look.triangles[len(triangles) :][shown[len(triangles) :]]
    # The caps of both halves lie at the cut, and look at each other.
    assert len(caps) > 50 and np.all(front[caps] == front[caps[:, :1]])
    a, b, c = (assembly.positions[caps[:, k]] for k in range(3))
    turned = np.cross(b - a, c - a)[:, 0]
    assert np.all(np.where(front[caps[:, 0]], turned < 0, turned > 0))
    assert look.cells.body_opens[0]


def test_the_gap_of_a_lone_broken_cell_closes():
    for dimension in (2, 3):
        cells = (3,) * dimension
        assembly = body({"kind": "box", "size": [0.3] * dimension, "cells": cells, "bracing": "body"}, dimension)
        middle = np.all(np.abs(assembly.positions) < 0.06, axis=1)
        # Diagonals first, which fewer cells share.
        own = np.flatnonzero(middle[assembly.spring_set.ends].all(axis=1))
        own = own[np.argsort(-assembly.spring_set.rest_lengths[own], kind="stable")]
        torn = np.zeros(assembly.spring_count, dtype=np.int32)
        torn[own[: assembly.appearance.cells.limit[0]]] = 1
        points, elements = seen(assembly, torn)
        assert np.count_nonzero(assembly.appearance.cells.broken(torn)) == 1 and is_closed(elements)
        np.testing.assert_allclose(points[middle], 0.0, atol=1e-12)
        assert np.array_equal(points[~middle], assembly.positions[~middle])


def test_faces_that_look_apart_move_nothing():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 1]])
    moved = gap_points(points, faces, np.array([0.1, 0.1]), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(moved[:, 2], 0.0)


def test_particles_that_are_seen_stay_with_the_surface():
    assembly = body({"kind": "box", "size": [1, 1], "cells": [4, 4]}, 2, render={"particles": True})
    torn, _ = crossing(assembly, [1.0, 0.0], 0.1)
    points, outline = seen(assembly, torn)
    assert is_closed(outline) and np.array_equal(points, assembly.positions)


def test_bodies_beside_each_other_keep_their_cells_apart():
    shapes = [box((2, 2, 2)), {"kind": "sheet", "size": [1.0, 1.0], "cells": [2, 2]}, box((3, 2, 2))]
    scene = make_scene(
        dimension=3,
        bodies=[
            {"name": f"b{k}", "shape": shape, "material": MATERIAL, "position": [3.0 * k, 0, 0]}
            for k, shape in enumerate(shapes)
        ],
    )
    assembly = assemble(scene)
    look = assembly.appearance
    torn = (assembly.spring_set.body == 2).astype(np.int32)
    shown = look.shown(torn).triangles
    assert np.array_equal(np.unique(look.triangle_body[shown]), [0, 1])
    assert np.count_nonzero(shown) == 2 * 24 + 8
    assert np.array_equal(look.cells.body_opens, [False, True, False])
    assert np.array_equal(assembly.particle_body[look.triangles[:, 0]], look.triangle_body)
