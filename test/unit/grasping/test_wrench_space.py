"""The wrench space against figures found by hand: cross polytope, cube, symmetric contacts, friction cones."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping import polytope
from mebo_grasp.grasping.hull_volume import hull_volume
from mebo_grasp.grasping.origin_distance import origin_distance
from mebo_grasp.grasping.wrench_space import (
    cone_edges,
    contact_wrenches,
    epsilon,
    force_closure,
    isotropy,
    volume,
)

FloatArray = npt.NDArray[np.float64]
ORIGIN = np.zeros(3)
AWKWARD_NORMALS = (
    (0.0, 0.0, 1.0),
    (0.0, 0.0, -1.0),
    (1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (1e-7, 0.0, -1.0),
    (1e-5, -2e-5, -1.0),
    (3e-9, 1e-9, -1.0),
    (1e-13, 1e-13, -1.0),
    (0.6, -0.48, 0.64),
)


def unit(vectors: npt.ArrayLike) -> FloatArray:
    array = np.asarray(vectors, dtype=np.float64)
    result: FloatArray = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return result


def twelve_frictionless(arm: float) -> tuple[FloatArray, FloatArray]:
    """Return two contacts on each face of a cube of side 2, off the middle by ``arm`` along y, z or x.

    Their wrenches are (+-1, 0, 0; 0, 0, +-arm), (0, +-1, 0; +-arm, 0, 0) and (0, 0, +-1; 0, +-arm, 0).
    """
    positions, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for shift in (-arm, arm):
                position, normal = np.zeros(3), np.zeros(3)
                position[axis], position[(axis + 1) % 3] = side, shift
                normal[axis] = -side
                positions.append(position)
                normals.append(normal)
    return np.array(positions), np.array(normals)


def ring(count: int, radius: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return contacts evenly round the equator of a sphere, normals inwards."""
    angles = 2.0 * np.pi * np.arange(count) / count
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    return radius * outward, -outward


@pytest.mark.parametrize("d", [2, 3, 4, 5, 6])
def test_the_cross_polytope_has_the_radius_and_volume_of_the_textbook(d: int) -> None:
    points = np.vstack([np.eye(d), -np.eye(d)])
    assert origin_distance(points) == pytest.approx(1.0 / math.sqrt(d), abs=1e-12)
    assert hull_volume(points) == pytest.approx(2.0**d / math.factorial(d), rel=1e-12)


@pytest.mark.parametrize("d", [2, 3, 4, 5, 6])
def test_the_cube_though_its_facets_are_no_simplices(d: int) -> None:
    points = np.array(np.meshgrid(*[[-1.0, 1.0]] * d)).reshape(d, -1).T.copy()
    assert origin_distance(points) == pytest.approx(1.0, abs=1e-12)
    assert hull_volume(points) == pytest.approx(2.0**d, rel=1e-12)


def test_a_moved_cube_counts_its_nearest_side_and_a_far_one_gives_zero() -> None:
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T.copy()
    shift = np.zeros(6)
    shift[3] = 0.75
    assert epsilon(cube + shift) == pytest.approx(0.25, abs=1e-12)
    assert volume(cube + shift) == pytest.approx(64.0, rel=1e-12)
    assert epsilon(cube + 2.0 * shift) == 0.0


def test_the_origin_on_the_surface_is_no_force_closure() -> None:
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T.copy()
    shift = np.zeros(6)
    shift[0] = 1.0
    assert epsilon(cube + shift) == pytest.approx(0.0, abs=1e-12)
    assert not force_closure(epsilon(cube + shift))


def test_more_points_than_the_compiled_search_takes_go_to_qhull() -> None:
    points = unit(np.random.default_rng(1).normal(size=(polytope.MOST_POINTS + 1, 3)))
    points[:6] = np.vstack([np.eye(3), -np.eye(3)])
    assert 0.9 < origin_distance(points) < 1.0
    assert 0.9 * 4.0 / 3.0 * np.pi < hull_volume(points) < 4.0 / 3.0 * np.pi


@pytest.mark.parametrize("arm", [0.2, 0.7, 1.0, 2.5])
@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_twelve_frictionless_contacts_on_a_cube_by_hand(arm: float, length: float) -> None:
    """The hull is the free sum of three rectangles with corners (+-1, +-a), a = arm / length.

    A free sum's gauge is the sum of the gauges, which is largest on the unit sphere at sqrt(3) / min(1, a); its volume
    is the product of k! times the volumes of the k-dimensional parts, over 6!.
    """
    positions, normals = twelve_frictionless(arm)
    wrenches = contact_wrenches(positions, normals, 0.0, 8, ORIGIN, length)
    a = arm / length
    assert wrenches.shape == (12, 6)
    assert epsilon(wrenches) == pytest.approx(min(1.0, a) / math.sqrt(3.0), abs=1e-12)
    assert volume(wrenches) == pytest.approx((2.0 * 4.0 * a) ** 3 / 720.0, rel=1e-9)


def test_a_wrench_by_hand() -> None:
    wrenches = contact_wrenches([[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], 0.0, 8, [0.5, 0.0, 0.0], 0.25)
    # (p - c) x f = (0.5, 2, 3) x (0, 0, 1) = (2, -0.5, 0)
    np.testing.assert_allclose(wrenches, [[0.0, 0.0, 1.0, 8.0, -2.0, 0.0]], atol=1e-15)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0, 5.0])
def test_two_antipodal_contacts_cannot_turn_the_object_about_their_line(friction: float) -> None:
    normals = unit([[-1.0, -2.0, 0.5], [1.0, 2.0, -0.5]])
    wrenches = contact_wrenches(-0.04 * normals, normals, friction, 8, ORIGIN, 0.1)
    assert epsilon(wrenches) == 0.0
    assert volume(wrenches) == 0.0
    assert not force_closure(epsilon(wrenches))


def test_three_contacts_round_a_sphere_hold_it_with_friction_and_not_without() -> None:
    positions, normals = ring(3)
    held = epsilon(contact_wrenches(positions, normals, 0.5, 8, ORIGIN, 1.0))
    assert held > 0.05
    assert force_closure(held)
    assert epsilon(contact_wrenches(positions, normals, 0.0, 8, ORIGIN, 1.0)) == 0.0


def test_one_contact_and_none_have_no_wrench_space() -> None:
    for count in (0, 1):
        normals = np.tile([0.0, 0.0, 1.0], (count, 1))
        wrenches = contact_wrenches(np.ones((count, 3)), normals, 0.5, 8, ORIGIN, 1.0)
        assert wrenches.shape == (8 * count, 6)
        assert (epsilon(wrenches), volume(wrenches)) == (0.0, 0.0)


def test_contacts_all_on_one_side_do_not_hold() -> None:
    rng = np.random.default_rng(3)
    positions = np.column_stack([rng.uniform(-1, 1, (6, 2)), np.full(6, -1.0)])
    normals = unit(np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.2, 0.2, (6, 3)))
    wrenches = contact_wrenches(positions, normals, 0.5, 8, ORIGIN, 1.0)
    assert epsilon(wrenches) == 0.0
    assert volume(wrenches) > 0.0


def test_parallel_normals_leave_the_hull_flat() -> None:
    """All edges then have the same force along the normal: five dimensions at most."""
    positions = np.random.default_rng(3).uniform(-1.0, 1.0, (6, 3))
    wrenches = contact_wrenches(positions, np.tile([0.0, 0.0, 1.0], (6, 1)), 0.5, 8, ORIGIN, 1.0)
    assert (epsilon(wrenches), volume(wrenches)) == (0.0, 0.0)


@pytest.mark.parametrize("friction", [0.05, 0.5, 1.0, 10.0])
@pytest.mark.parametrize("edges", [3, 4, 8, 64])
def test_the_edges_of_the_pyramid_lie_on_the_cone_evenly(friction: float, edges: int) -> None:
    normals = unit(AWKWARD_NORMALS)
    directions = cone_edges(normals, friction, edges)
    assert directions.shape == (len(normals), edges, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1.0, atol=1e-11)
    along = np.einsum("ijk,ik->ij", directions, normals)
    np.testing.assert_allclose(np.arccos(along), np.arctan(friction), atol=1e-9)
    np.testing.assert_allclose(directions.sum(axis=1), edges * along[:, :1] * normals, atol=1e-9)
    steps = np.einsum("ijk,ijk->ij", directions, np.roll(directions, 1, axis=1))
    np.testing.assert_allclose(steps, steps[:, :1] * np.ones(edges), atol=1e-9)


def test_a_frictionless_contact_pushes_along_its_normal_only() -> None:
    normals = unit(AWKWARD_NORMALS)
    np.testing.assert_array_equal(cone_edges(normals, 0.0, 8), normals[:, None, :])


def test_isotropy_of_three_contacts_round_a_sphere_by_hand() -> None:
    """G G' = diag(3, 3, 3, 1.5 q, 1.5 q, 3 q) with q = (radius / length)^2."""
    positions, normals = ring(3, 0.5)
    assert isotropy(positions, normals, ORIGIN, 0.5) == pytest.approx(math.sqrt(0.5), abs=1e-12)
    assert isotropy(positions, normals, ORIGIN, 1.0) == pytest.approx(math.sqrt(1.5 * 0.25 / 3.0), abs=1e-12)
    assert isotropy(positions, normals, ORIGIN, 0.25) == pytest.approx(math.sqrt(3.0 / 12.0), abs=1e-12)


def test_isotropy_is_zero_without_full_rank() -> None:
    assert isotropy(np.zeros((0, 3)), np.zeros((0, 3)), ORIGIN, 1.0) == 0.0
    assert isotropy([[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]], ORIGIN, 1.0) == 0.0
    line = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.2], [0.0, 0.0, 1.0]])
    assert isotropy(line, np.tile([1.0, 0.0, 0.0], (3, 1)), ORIGIN, 1.0) == 0.0


@pytest.mark.parametrize("friction", [-0.1, np.nan, np.inf])
def test_a_friction_out_of_range_is_refused(friction: float) -> None:
    with pytest.raises(InvalidSettingsError, match="friction"):
        contact_wrenches([[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]], friction, 8, ORIGIN, 1.0)


@pytest.mark.parametrize("edges", [-1, 0, 2])
def test_too_few_edges_are_refused(edges: int) -> None:
    with pytest.raises(InvalidSettingsError, match="3 edges"):
        contact_wrenches([[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]], 0.5, edges, ORIGIN, 1.0)


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf])
def test_a_torque_length_out_of_range_is_refused(length: float) -> None:
    with pytest.raises(InvalidSettingsError, match="torque length"):
        contact_wrenches([[0.0, 0.0, 1.0]], [[0.0, 0.0, -1.0]], 0.5, 8, ORIGIN, length)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_contacts_that_are_not_finite_are_refused(bad: float) -> None:
    with pytest.raises(InvalidSettingsError, match="finite"):
        contact_wrenches([[0.0, bad, 1.0]], [[0.0, 0.0, -1.0]], 0.5, 8, ORIGIN, 1.0)
    with pytest.raises(InvalidSettingsError, match="finite"):
        contact_wrenches([[0.0, 0.0, 1.0]], [[0.0, bad, -1.0]], 0.5, 8, ORIGIN, 1.0)


@pytest.mark.parametrize(("points", "normals"), [(1, 2), (2, 1), (3, 0)])
def test_contacts_need_one_normal_each(points: int, normals: int) -> None:
    with pytest.raises(InvalidSettingsError, match="one normal each"):
        contact_wrenches(np.ones((points, 3)), np.tile([0.0, 0.0, 1.0], (normals, 1)), 0.5, 8, ORIGIN, 1.0)
