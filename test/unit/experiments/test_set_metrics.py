"""What sets and archives are worth, against values found by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mebo_grasp.experiments.scores.set_metrics import (
    best_so_far,
    best_value,
    diverse_count,
    hypervolume,
    occluded_best,
    quality_diversity_volume,
    retention,
)

NAN = float("nan")
LINE = np.array([[0.0], [10.0], [30.0], [70.0], [130.0]])


def test_best_so_far_keeps_the_best_and_passes_over_failures() -> None:
    curve = best_so_far(np.array([NAN, 0.2, NAN, 0.1, 0.5, 0.4]))
    np.testing.assert_array_equal(curve, [NAN, 0.2, 0.2, 0.2, 0.5, 0.5])
    assert len(best_so_far(np.empty(0))) == 0
    assert best_value(np.array([NAN, -2.0, -3.0])) == -2.0
    assert np.isnan(best_value(np.array([NAN])))


@pytest.mark.parametrize(("tau", "expected"), [(5.0, 5), (15.0, 4), (25.0, 3), (45.0, 2), (100.0, 1)])
def test_points_linked_by_near_neighbours_count_once(tau: float, expected: int) -> None:
    # Gaps 10, 20, 40, 60: each tau above a gap joins what lies on both sides of it.
    assert diverse_count(LINE, tau) == expected


def test_a_distance_of_exactly_tau_is_diverse_and_an_empty_set_has_none() -> None:
    assert diverse_count(np.array([[0.0], [40.0]]), 40.0) == 2
    assert diverse_count(np.empty((0, 1)), 40.0) == 0


def test_occluded_best_is_the_best_left_or_0() -> None:
    y = np.array([0.9, NAN, 0.4, 0.6])
    assert occluded_best(y, np.array([False, True, True, True])) == 0.6
    assert occluded_best(y, np.array([False, True, False, False])) == 0.0


@pytest.mark.parametrize(
    ("radius", "y", "expected"),
    [
        # Best at 0; a point on the surface of the ball is dropped.
        (5.0, [1.0, 0.9, 0.5, 0.75, 0.1], 0.9),
        (10.0, [1.0, 0.9, 0.5, 0.3, 0.1], 0.5),
        (30.0, [1.0, 0.9, 0.95, 0.75, 0.1], 0.75),
        (70.0, [1.0, 0.9, 0.95, 0.75, 0.1], 0.1),
        (130.0, [1.0, 0.9, 0.95, 0.75, 0.1], 0.0),
        # As a share of the best, wherever that lies.
        (25.0, [0.2, 0.6, 0.8, 0.4, 0.1], 0.5),
    ],
)
def test_retention_drops_the_ball_about_the_best(radius: float, y: list[float], expected: float) -> None:
    assert retention(LINE, np.array(y), radius) == pytest.approx(expected)


def test_retention_of_what_has_no_value_is_none() -> None:
    assert np.isnan(retention(LINE, np.zeros(5), 20.0))
    assert np.isnan(retention(np.empty((0, 3)), np.empty(0), 20.0))
    assert retention(LINE, np.array([0.5, NAN, NAN, NAN, -0.2]), 20.0) == 0.0


def test_hypervolume_is_the_area_of_the_staircase() -> None:
    # 1 x 3, then 1 x 2 more in the first objective, then 1 x 1 more; (1, 1) is dominated, (-1, 9) out of range.
    points = np.array([[1.0, 3.0], [2.0, 2.0], [3.0, 1.0], [1.0, 1.0], [-1.0, 9.0]])
    assert hypervolume(points) == pytest.approx(3 + 2 + 1)
    assert hypervolume(np.empty((0, 2))) == 0.0


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)), min_size=1, max_size=8))
def test_hypervolume_equals_a_count_of_grid_cells(pairs: list[tuple[float, float]]) -> None:
    points = np.round(np.array(pairs) * 4) / 4
    centres = np.arange(0.125, 5.0, 0.25)
    dominated = np.any(
        (points[:, None, None, 0] > centres[:, None]) & (points[:, None, None, 1] > centres[None, :]), axis=0
    )
    assert hypervolume(points) == pytest.approx(0.0625 * np.count_nonzero(dominated))


def test_quality_diversity_volume_by_hand() -> None:
    # Two points 40 apart, M = 2: quality (1 + 0.5) / 2 up to a distance of 40, beyond it the best alone, 1 / 2.
    X, y = np.array([[0.0], [40.0], [500.0]]), np.array([1.0, 0.5, NAN])
    assert quality_diversity_volume(X, y, 2, 80.0) == pytest.approx(0.5 * 0.75 + 0.5 * 0.5)
    assert quality_diversity_volume(X, np.full(3, NAN), 2, 80.0) == 0.0


def test_quality_diversity_volume_falls_when_a_far_point_moves_near() -> None:
    y = np.array([1.0, 0.9])
    far, near = np.array([[0.0], [80.0]]), np.array([[0.0], [20.0]])
    assert quality_diversity_volume(far, y, 2, 80.0) > quality_diversity_volume(near, y, 2, 80.0)
