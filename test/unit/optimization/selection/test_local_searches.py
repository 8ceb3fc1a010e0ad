"""Local searches: whose turn it is, where their boxes lie, and what they propose."""

import numpy as np
import pytest

from mebo_grasp.optimization.selection.local_searches import (
    EXPLORATION,
    EXPLORATION_PERIOD,
    LENGTHS,
    PATIENCE,
    LocalSearches,
    rank_of,
)
from mebo_grasp.optimization.surrogate.belief import PlateauSurrogate

SIDES = np.ones(2)
FLAT = np.full(2, 0.5)
"""Lengthscales that leave a box square."""
RNG = np.random.default_rng(0)


def searches(points, values, size=2, sides=SIDES, distance=0.3):
    return LocalSearches(np.array(points), np.array(values), 0.0, sides, size, distance)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 7, 20])
def test_every_search_has_its_turn_and_the_best_has_at_least_every_fourth(size):
    turns = [rank_of(turn, size) for turn in range(60 * size)]
    assert turns.count(EXPLORATION) == len(turns) / EXPLORATION_PERIOD
    assert turns[EXPLORATION_PERIOD - 1] == EXPLORATION
    turns = [rank for rank in turns if rank != EXPLORATION]
    assert set(turns) == set(range(size))
    assert turns.count(0) >= len(turns) / 4
    others = [turns.count(rank) for rank in range(1, size)]
    assert not others or max(others) - min(others) <= 1


def test_centres_are_diverse_and_off_the_plateau():
    found = searches([[0.1, 0.1], [0.2, 0.1], [0.9, 0.9], [0.5, 0.5]], [2.0, 3.0, 0.0, 1.0], size=4)
    assert found.centres.tolist() == [1, 3]


def test_distance_counts_in_the_weighted_sides():
    points, values = [[0.1, 0.1], [0.1, 0.9]], [2.0, 1.0]
    assert searches(points, values, sides=np.array([1.0, 1.0])).centres.tolist() == [0, 1]
    assert searches(points, values, sides=np.array([1.0, 0.1])).centres.tolist() == [0]


def test_box_lies_around_its_centre_and_is_the_cube_while_there_is_none():
    found = searches([[0.3, 0.3], [0.8, 0.7]], [1.0, 2.0], size=3)
    for rank, centre in enumerate(([0.8, 0.7], [0.3, 0.3])):
        corners = np.clip([np.subtract(centre, 0.2), np.add(centre, 0.2)], 0.0, 1.0)
        np.testing.assert_allclose(found.box(rank, FLAT, RNG), corners)
    np.testing.assert_array_equal(found.box(2, FLAT, RNG), [[0.0, 0.0], [1.0, 1.0]])


def test_box_takes_the_next_length_after_idle_trials_nearest_to_its_centre():
    centres, values = [[0.2, 0.2], [0.8, 0.8]], [2.0, 1.0]

    def side(idle, rank):
        idle_points = [[0.2 + 0.001 * i, 0.25] for i in range(idle)]
        low, high = searches(centres + idle_points, values + [0.5] * idle).box(rank, FLAT, RNG)
        return high[1] - low[1]

    assert side(PATIENCE - 1, 0) == pytest.approx(LENGTHS[0])
    assert side(PATIENCE, 0) == pytest.approx(LENGTHS[1])
    assert side(PATIENCE * (len(LENGTHS) - 1), 0) == pytest.approx(LENGTHS[-1])
    assert side(PATIENCE * len(LENGTHS), 0) == pytest.approx(LENGTHS[0])
    assert side(PATIENCE * 2, 1) == pytest.approx(LENGTHS[0])


def test_trials_from_before_the_centre_was_found_do_not_count():
    early = [[0.2, 0.2 + 0.001 * i] for i in range(PATIENCE)]
    low, high = searches([*early, [0.2, 0.25]], [0.5] * PATIENCE + [2.0], size=1).box(0, FLAT, RNG)
    assert high[0] - low[0] == pytest.approx(LENGTHS[0])


def test_exploration_lies_around_a_further_diverse_point():
    points = [[0.5, 0.9], [0.1, 0.1], [0.12, 0.1], [0.9, 0.3], [0.5, 0.5]]
    found = searches(points, [0.0, 3.0, 2.0, 1.0, 2.5])
    assert found.centres.tolist() == [1, 4]
    np.testing.assert_allclose(found.box(EXPLORATION, FLAT, RNG), [[0.7, 0.1], [1.0, 0.5]])
    without = searches(points[:3], [0.0, 3.0, 2.0])
    np.testing.assert_array_equal(without.box(EXPLORATION, FLAT, RNG), [[0.0, 0.0], [1.0, 1.0]])


def test_incumbent_of_an_exploration_is_the_best_nearby_however_low():
    found = searches([[0.1, 0.1], [0.9, 0.9], [0.5, 0.5], [0.9, 0.1]], [3.0, 2.0, 0.5, 0.0])
    points = np.array([[0.15, 0.1], [0.5, 0.55], [0.9, 0.15]])
    assert found.incumbents(points, 0).tolist() == [3.0, 2.0, 2.0]
    assert found.incumbents(points, EXPLORATION).tolist() == [3.0, 0.5, 0.0]


def hills(U):
    """Two hills of heights 1 and 0.8 on a plateau at 0, shape (n,)."""
    near = [np.linalg.norm(U - centre, axis=1) for centre in ([0.3, 0.3], [0.75, 0.75])]
    return np.maximum(0.0, np.maximum(1.0 - 5.0 * near[0], 0.8 - 5.0 * near[1]))


@pytest.mark.parametrize(("rank", "summit"), [(0, [0.3, 0.3]), (1, [0.75, 0.75])])
def test_each_search_climbs_its_own_hill(rank, summit):
    U = np.random.default_rng(3).random((120, 2))
    y = hills(U)
    belief = PlateauSurrogate(2).update(U, y, np.random.default_rng(0)).best
    found = LocalSearches(U, y, belief.floor, SIDES, 2, 0.3)
    low, high = found.box(rank, np.exp(belief.value.hyperparameters.theta[:2]), RNG)
    point = found.pick(belief, rank, np.random.default_rng(1))
    assert np.all((low <= point) & (point <= high))
    assert np.linalg.norm(point - summit) < 0.1
    assert hills(point[None])[0] > y[found.centres[rank]]
