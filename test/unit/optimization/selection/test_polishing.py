"""Polishing closes in on maxima that no smooth model fits."""

import numpy as np
import pytest

from mebo_grasp.optimization.selection.polishing import polish


def tent(u):
    """A kinked summit, steeper on one side, at 0.3 in each dimension."""
    return -float(np.sum(np.where(u < 0.3, 3.0 * (0.3 - u), u - 0.3)))


@pytest.mark.parametrize(("dim", "trials", "accuracy"), [(1, 40, 2e-5), (2, 150, 2e-3)])
def test_kinked_summit_is_closed_in_on(dim, trials, accuracy):
    rng = np.random.default_rng(0)
    U = rng.random((20, dim))
    for _ in range(trials):
        y = np.array([tent(u) for u in U])
        point = polish(U, y, np.array([np.argmax(y)]), -0.1, 1e-9, rng)
        if point is None:
            break
        U = np.concatenate([U, point[None]])
    assert -max(tent(u) for u in U) < accuracy


def test_in_one_dimension_the_larger_side_of_the_bracket_is_halved():
    U = np.array([[0.0], [0.1], [0.5], [0.6], [1.0]])
    y = np.array([0.0, 0.1, 1.0, 0.2, 0.0])
    point = polish(U, y, np.array([2]), 0.9, 1e-9, np.random.default_rng(0))
    assert point is not None
    np.testing.assert_allclose(point, [0.3])


@pytest.mark.parametrize(("nearest_ahead", "step"), [(0.4006, 0.0003), (0.5, 0.0004)])
def test_on_a_slope_it_goes_uphill_half_way_to_what_is_tried_there_or_four_times_as_far(nearest_ahead, step):
    U = np.array([[0.0], [0.3998], [0.3999], [0.4], [nearest_ahead], [1.0]])
    y = np.array([0.0, 0.9, 0.95, 1.0, 0.0, 0.0])
    for seed in range(4):
        point = polish(U, y, np.array([3]), 0.9, 1e-9, np.random.default_rng(seed))
        assert point is not None
        np.testing.assert_allclose(point, [0.4 + step])


def test_what_a_slope_promises_grows_with_the_step():
    U = np.array([[0.0], [0.3998], [0.3999], [0.4], [0.5], [1.0]])
    y = np.array([0.0, 0.9, 0.95, 1.0, 0.0, 0.0])
    # It falls by (0.05 + 0.1) / 2 to the neighbours, and the step is four times as long as one among them.
    assert polish(U, y, np.array([3]), 1.29, 1e-9, np.random.default_rng(0)) is not None
    assert polish(U, y, np.array([3]), 1.31, 1e-9, np.random.default_rng(0)) is None


def test_on_a_slope_in_the_plane_it_goes_away_from_the_neighbours_but_not_out_of_the_cube():
    behind = 0.01 * np.array([[-1.0, 0.0], [-1.0, 0.5], [-0.5, 0.0], [-0.5, -0.5]])
    far = np.array([[0.2, 0.1], [0.2, 0.9], [0.4, 0.5], [0.1, 0.5]])
    for best, reach in (([0.7, 0.5], 0.03), ([0.99, 0.5], 0.01)):
        U = np.concatenate([[best], best + behind, far])
        y = np.array([1.0, 0.9, 0.9, 0.95, 0.95, 0.0, 0.0, 0.0, 0.0])
        point = polish(U, y, np.array([0]), 0.9, 1e-9, np.random.default_rng(0))
        assert point is not None
        assert best[0] + 0.4 * reach < point[0] <= best[0] + reach
        assert abs(point[1] - best[1]) < 0.3 * (point[0] - best[0])


def test_along_the_border_of_the_cube_it_stays_on_it():
    U = np.array(
        [[0.5, 0.0], [0.49, 0.0], [0.48, 0.0], [0.47, 0.0], [0.46, 0.0], [0.1, 0.9], [0.9, 0.9], [0.1, 0.5], [0.9, 0.5]]
    )
    y = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.0, 0.0, 0.0, 0.0])
    point = polish(U, y, np.array([0]), 0.9, 1e-9, np.random.default_rng(0))
    assert point is not None
    np.testing.assert_allclose(point, [0.58, 0.0])


def test_the_incumbent_that_may_gain_most_comes_first():
    U = np.array([[0.0], [0.1], [0.101], [0.102], [0.2], [0.5], [0.55], [0.6], [0.7], [0.8]])
    y = np.array([0.0, 0.5, 1.0, 0.5, 0.0, 0.0, 0.2, 1.0, 0.1, 0.0])

    def polished(top, resolution, y=y):
        return polish(U, y, np.array([2, 7]), top, resolution, np.random.default_rng(0))

    # It falls by 0.5 around 0.101 and by (0.8 + 0.9) / 2 around 0.6.
    assert abs(polished(0.9, 1e-9)[0] - 0.6) == pytest.approx(0.05)
    # One that is lower comes first as well if what it may gain lifts it to the top: 0.7 + 0.55 = 1.25.
    lower = np.where(np.arange(10) == 7, 0.7, y)
    assert abs(polished(1.0, 1e-9, lower)[0] - 0.6) == pytest.approx(0.05)
    assert abs(polished(1.3, 1e-9, lower)[0] - 0.101) == pytest.approx(0.0005)
    assert polished(1.6, 1e-9, lower) is None
    # 0.5 is too little, 0.85 not.
    assert abs(polished(0.9, 0.6)[0] - 0.6) == pytest.approx(0.05)
    assert polished(0.9, 0.9) is None


def test_an_incumbent_beside_a_better_one_is_left_out():
    U = np.array([[0.0], [0.2], [0.5], [0.51], [0.9]])
    y = np.array([0.0, 0.1, 0.9, 1.0, 0.0])
    assert polish(U, y, np.array([2]), 0.9, 1e-9, np.random.default_rng(0)) is None


def test_nothing_is_left_when_all_are_exact():
    U = 0.1 + 1e-9 * np.arange(-2.0, 3.0)[:, None]
    y = 1.0 - np.abs(np.arange(-2.0, 3.0))
    assert polish(U, y, np.array([2]), 0.9, 1e-9, np.random.default_rng(0)) is None
    assert polish(U, y, np.array([], dtype=np.int64), 0.9, 1e-9, np.random.default_rng(0)) is None
