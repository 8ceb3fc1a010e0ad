"""Local searches: whose turn it is, where their boxes lie, and what they propose."""

import numpy as np
import pytest

from mebo_grasp.optimization.selection.local_searches import (
    EXPLORATION,
    EXPLORATION_PERIOD,
    LENGTHS,
    NUM_STEPS,
    PATIENCE,
    STEP_SD,
    LocalSearches,
    box_around,
    rank_of,
    steps_from,
)
from mebo_grasp.optimization.surrogate.belief import PlateauSurrogate

SIDES = np.ones(2)
RNG = np.random.default_rng(0)


def searches(points, values, size=2, sides=SIDES, distance=0.3):
    return LocalSearches(np.array(points), np.array(values), 0.0, sides, size, distance)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 7, 20])
def test_every_search_has_its_turn_and_the_best_has_at_least_every_second(size):
    turns = [rank_of(turn, size) for turn in range(60 * size)]
    assert turns.count(EXPLORATION) == len(turns) / EXPLORATION_PERIOD
    assert turns[EXPLORATION_PERIOD - 1] == EXPLORATION
    turns = [rank for rank in turns if rank != EXPLORATION]
    assert set(turns) == set(range(size))
    assert turns.count(0) >= len(turns) / 2
    others = [turns.count(rank) for rank in range(1, size)]
    assert not others or max(others) - min(others) <= 1


def test_centres_are_diverse_and_off_the_plateau():
    found = searches([[0.1, 0.1], [0.2, 0.1], [0.9, 0.9], [0.5, 0.5]], [2.0, 3.0, 0.0, 1.0], size=4)
    assert found.centres.tolist() == [1, 3]


def test_distance_counts_in_the_weighted_sides():
    points, values = [[0.1, 0.1], [0.1, 0.9]], [2.0, 1.0]
    assert searches(points, values, sides=np.array([1.0, 1.0])).centres.tolist() == [0, 1]
    assert searches(points, values, sides=np.array([1.0, 0.1])).centres.tolist() == [0]


def test_reach_has_its_centre_and_is_the_cube_while_there_is_none():
    found = searches([[0.3, 0.3], [0.8, 0.7]], [1.0, 2.0], size=3)
    for rank, expected in enumerate(([0.8, 0.7], [0.3, 0.3])):
        centre, length = found.reach(rank, RNG)
        assert centre.tolist() == expected
        assert length == LENGTHS[0]
    assert found.reach(2, RNG) == (None, 1.0)


def test_reach_takes_the_next_length_after_idle_trials_nearest_to_its_centre():
    centres, values = [[0.2, 0.2], [0.8, 0.8]], [2.0, 1.0]

    def length(idle, rank):
        idle_points = [[0.2 + 0.001 * i, 0.25] for i in range(idle)]
        return searches(centres + idle_points, values + [0.5] * idle).reach(rank, RNG)[1]

    assert length(PATIENCE - 1, 0) == LENGTHS[0]
    assert length(PATIENCE, 0) == LENGTHS[1]
    assert length(PATIENCE * (len(LENGTHS) - 1), 0) == LENGTHS[-1]
    assert length(PATIENCE * len(LENGTHS), 0) == LENGTHS[0]
    assert length(PATIENCE * 2, 1) == LENGTHS[0]


def test_trials_from_before_the_centre_was_found_do_not_count():
    early = [[0.2, 0.2 + 0.001 * i] for i in range(PATIENCE)]
    found = searches([*early, [0.2, 0.25]], [0.5] * PATIENCE + [2.0], size=1)
    assert found.reach(0, RNG)[1] == LENGTHS[0]


def test_exploration_is_centred_at_a_further_diverse_point():
    points = [[0.5, 0.9], [0.1, 0.1], [0.12, 0.1], [0.9, 0.3], [0.5, 0.5]]
    found = searches(points, [0.0, 3.0, 2.0, 1.0, 2.5])
    assert found.centres.tolist() == [1, 4]
    centre, length = found.reach(EXPLORATION, RNG)
    assert (centre.tolist(), length) == ([0.9, 0.3], LENGTHS[0])
    assert searches(points[:3], [0.0, 3.0, 2.0]).reach(EXPLORATION, RNG) == (None, 1.0)


def test_box_lies_around_its_centre_and_is_the_cube_without_one(belief):
    centre, length = np.array([0.5, 0.45]), 0.1
    low, high = box_around(centre, length, belief)
    np.testing.assert_allclose(0.5 * (low + high), centre)
    assert np.prod(high - low) == pytest.approx(length**2)
    np.testing.assert_array_equal(box_around(None, 1.0, belief), [[0.0, 0.0], [1.0, 1.0]])


def test_steps_move_some_coordinates_by_a_share_of_the_length():
    centre, rng = np.full(6, 0.5), np.random.default_rng(0)
    moves = np.concatenate([steps_from(centre, 0.2, 6, rng) - centre for _ in range(100)])
    moved = moves != 0.0
    assert moved.any(axis=1).all()
    # Each of six moves with probability 1 - (1 - 1/2) (1 - 1/6).
    assert np.mean(moved) == pytest.approx(7.0 / 12.0, abs=0.03)
    assert np.std(moves[moved]) == pytest.approx(STEP_SD * 0.2, rel=0.05)


def test_steps_without_a_centre_are_spread_over_the_cube():
    points = np.concatenate([steps_from(None, 1.0, 2, np.random.default_rng(i)) for i in range(50)])
    assert points.shape == (50 * NUM_STEPS, 2)
    np.testing.assert_allclose([points.mean(), points.std()], [0.5, 12.0**-0.5], atol=0.02)


def test_incumbent_of_an_exploration_is_the_best_nearby_however_low():
    found = searches([[0.1, 0.1], [0.9, 0.9], [0.5, 0.5], [0.9, 0.1]], [3.0, 2.0, 0.5, 0.0])
    points = np.array([[0.15, 0.1], [0.5, 0.55], [0.9, 0.15]])
    assert found.incumbents(points, 0).tolist() == [3.0, 2.0, 2.0]
    assert found.incumbents(points, EXPLORATION).tolist() == [3.0, 0.5, 0.0]


def hills(U):
    """Two hills of heights 1 and 0.8 on a plateau at 0, shape (n,)."""
    near = [np.linalg.norm(U - centre, axis=1) for centre in ([0.3, 0.3], [0.75, 0.75])]
    return np.maximum(0.0, np.maximum(1.0 - 5.0 * near[0], 0.8 - 5.0 * near[1]))


@pytest.fixture(scope="module")
def tried():
    U = np.random.default_rng(3).random((120, 2))
    return U, hills(U)


@pytest.fixture(scope="module")
def belief(tried):
    U, y = tried
    return PlateauSurrogate(2).update(U, y, np.random.default_rng(0)).best


@pytest.mark.parametrize(("rank", "summit"), [(0, [0.3, 0.3]), (1, [0.75, 0.75])])
def test_each_search_climbs_its_own_hill(tried, belief, rank, summit):
    U, y = tried
    found = LocalSearches(U, y, belief.floor, SIDES, 2, 0.3)
    rng = np.random.default_rng(1)
    points = np.array([found.pick(belief, rank, rng) for _ in range(20)])
    assert np.all((points >= 0.0) & (points <= 1.0))
    assert np.all(np.linalg.norm(points - summit, axis=1) < 0.2)
    # About half of the picks are the best of the box, the others steps, of which most promise less.
    assert np.mean(hills(points) > y[found.centres[rank]]) > 0.5


def test_turns_of_points_not_found_yet_are_spread_over_what_is_promising(tried, belief):
    U, y = tried
    found = LocalSearches(U, y, belief.floor, SIDES, 6, 0.3)
    missing = len(found.centres)
    assert missing < 6
    rng = np.random.default_rng(1)
    points = np.array([found.pick(belief, missing, rng) for _ in range(50)])
    # A fifth of the square is off the plateau. The largest gain alone would give the same summit again and again.
    assert np.mean(hills(points) > 0.0) > 0.9
    assert np.all(np.std(points, axis=0) > 0.02)
