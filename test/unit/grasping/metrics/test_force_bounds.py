"""Epsilon with one limit a contact (L-infinity) against the whole Minkowski sum by Qhull, and by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mebo_grasp.grasping.minkowski_sum import sum_origin_distance
from mebo_grasp.grasping.wrench_space import contact_wrenches, epsilon


def whole_sum(sets: np.ndarray) -> float:
    """Return the ball's radius from all (m + 1)^n corners, the way that is too slow for real grasps."""
    with_nothing = np.concatenate([np.zeros((len(sets), 1, sets.shape[2])), sets], axis=1)
    choices = itertools.product(range(with_nothing.shape[1]), repeat=len(sets))
    corners = np.array([sum(with_nothing[i, k] for i, k in enumerate(choice)) for choice in choices])
    return max(0.0, float((-ConvexHull(corners).equations[:, -1]).min()))


def random_sets(rng: np.random.Generator, contacts: int, edges: int, friction: float = 0.9) -> np.ndarray:
    outward = rng.normal(size=(contacts, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    wrenches = contact_wrenches(0.04 * outward, -outward, friction, edges, np.zeros(3), 0.08)
    return wrenches.reshape(contacts, edges, 6)


@pytest.mark.parametrize(("contacts", "edges"), [(3, 3), (4, 3), (4, 4), (5, 3)])
def test_the_ball_is_that_of_the_whole_sum(contacts: int, edges: int) -> None:
    rng = np.random.default_rng([contacts, edges])
    closed = 0
    for _ in range(8):
        sets = random_sets(rng, contacts, edges)
        expected = whole_sum(sets)
        assert sum_origin_distance(sets) == pytest.approx(expected, abs=1e-9)
        closed += expected > 1e-6
    assert closed >= 1


def test_pushes_along_the_axes_by_hand() -> None:
    """Six contacts push along +-e_k: together they fill the cube of side 2, alone the cross polytope."""
    d = 6
    sets = np.vstack([np.eye(d), -np.eye(d)])[:, None, :]
    assert sum_origin_distance(sets) == pytest.approx(1.0, abs=1e-12)
    assert epsilon(sets.reshape(-1, d)) == pytest.approx(1.0 / math.sqrt(d), abs=1e-12)


@pytest.mark.parametrize("contacts", [3, 6, 10, 15])
def test_single_limits_allow_at_least_the_common_one_and_at_most_n_times_it(contacts: int) -> None:
    rng = np.random.default_rng(contacts)
    closed = 0
    for _ in range(10):
        sets = random_sets(rng, contacts, 8, 0.5)
        common, single = epsilon(sets.reshape(-1, 6)), sum_origin_distance(sets)
        assert common - 1e-9 <= single <= contacts * common + 1e-9
        assert (single > 1e-6) == (common > 1e-6)
        closed += common > 1e-6
    assert closed >= (0 if contacts == 3 else 5)


def test_no_contact_and_contacts_that_do_not_hold_give_zero() -> None:
    assert sum_origin_distance(np.zeros((0, 8, 6))) == 0.0
    rng = np.random.default_rng(5)
    assert sum_origin_distance(random_sets(rng, 1, 8)) == 0.0
    assert sum_origin_distance(np.abs(random_sets(rng, 6, 8)) + 0.01) == 0.0


def test_contacts_at_the_corners_of_a_cube_do_not_stop_the_search() -> None:
    """Every facet of so regular a sum has more corners than it needs."""
    outward = np.array(list(itertools.product([-1.0, 1.0], repeat=3))) / math.sqrt(3.0)
    for edges in (4, 8):
        wrenches = contact_wrenches(0.05 * outward, -outward, 0.5, edges, np.zeros(3), 0.05)
        assert sum_origin_distance(wrenches.reshape(8, edges, 6)) > epsilon(wrenches) > 0.05
