"""Each counting rule against traces that were made, and counted, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import get_problem, transform
from mebo_grasp.experiments.problems.metrics import (
    RunScore,
    basin,
    competition_count,
    mean_batch_variance,
    strict_count,
    summarize,
    text_count,
    thesis_accuracy,
    thesis_score,
)

TRAP = get_problem("five_uneven_peak_trap")
EQUAL = get_problem("equal_maxima")
RASTRIGIN = get_problem("modified_rastrigin")


def _column(*xs: float) -> np.ndarray:
    return np.array(xs, dtype=float)[:, None]


@pytest.mark.parametrize(
    ("name", "accuracy"),
    [("himmelblau", 10.0), ("modified_rastrigin", 0.1), ("vincent_2d", 0.05), ("cf1_2d", 0.05)],
)
def test_five_percent_of_the_optimum_or_absolute_at_zero(name: str, accuracy: float) -> None:
    assert thesis_accuracy(get_problem(name)) == pytest.approx(accuracy)


def test_list_rule_counts_first_finds_and_later_improvements_apart() -> None:
    # Values 80, 192, 160 (a miss at 5 %: 190), 200, 196, 200, 0. First: 192 at x = 0.1 (evaluation 2).
    X = _column(1.5, 0.1, 5.0, 30.0, 0.05, 0.0, 2.5)
    score = thesis_score(TRAP, X, TRAP(X))
    assert score.found == 2
    assert score.success
    assert score.first_all == pytest.approx(4 / 7)
    assert score.last_change == pytest.approx(6 / 7)
    assert score.curve.tolist() == [0, 1, 1, 2, 2, 2, 2]
    assert sorted(score.found_values) == [200.0, 200.0]


def test_list_rule_takes_the_budget_as_the_whole() -> None:
    X = _column(0.0, 30.0)
    score = thesis_score(TRAP, X, TRAP(X), budget=10)
    assert (score.first_all, score.last_change) == (0.2, 0.2)
    with pytest.raises(InvalidSettingsError, match="budget must be at least"):
        thesis_score(TRAP, X, TRAP(X), budget=1)


def test_unsuccessful_run_uses_the_whole_budget() -> None:
    X = _column(0.0, 1.0, 2.0)
    score = thesis_score(TRAP, X, TRAP(X))
    assert (score.found, score.success, score.first_all, score.last_change) == (1, False, 1.0, 1.0)


def test_list_rule_credits_the_nearest_optimum_however_far() -> None:
    # A value told as a hit at x = 14 is nearer to 0 than to 30, although no optimum is near.
    score = thesis_score(TRAP, _column(14.0), np.array([195.0]))
    assert score.found == 1
    assert score.found_values.tolist() == [195.0]


def test_failed_trials_are_no_hits() -> None:
    score = thesis_score(TRAP, _column(0.0, 30.0), np.array([np.nan, 200.0]))
    assert score.found == 1
    assert score.curve.tolist() == [0, 1]
    assert thesis_score(TRAP, np.empty((0, 1)), np.empty(0), budget=5).found == 0


def test_radius_rule_tells_peaks_apart_and_stops_at_the_last_new_one() -> None:
    offsets = np.array([[0.0, 0.0], [0.002, 0.0], [0.0, -0.002]])
    X = np.concatenate([[p] for p in RASTRIGIN.optima] + [RASTRIGIN.optima[:1] + o for o in offsets])
    score = thesis_score(RASTRIGIN, X, RASTRIGIN(X))
    assert score.found == 12
    # Unlike the list rule, the later hits on the first peak do not count.
    assert score.first_all == score.last_change == pytest.approx(12 / 15)
    missing = thesis_score(RASTRIGIN, X[1:12], RASTRIGIN(X[1:12]))
    assert (missing.found, missing.first_all) == (11, 1.0)


def test_radius_rule_has_the_tolerance_of_a_tenth_at_rastrigin() -> None:
    # -2 - 9 (1 - cos(6 pi dx)): dx = 0.0075 gives -2.0897, dx = 0.0085 gives -2.115.
    peak = RASTRIGIN.optima[0]
    inside, outside = peak + np.array([0.0075, 0.0]), peak + np.array([0.0085, 0.0])
    assert thesis_score(RASTRIGIN, inside[None], RASTRIGIN([inside])).found == 1
    assert thesis_score(RASTRIGIN, outside[None], RASTRIGIN([outside])).found == 0


def test_radius_of_the_thesis_shrinks_with_a_transformed_problem() -> None:
    moved = transform(RASTRIGIN, 0)
    score = thesis_score(moved, moved.optima, moved(moved.optima))
    assert (score.found, score.first_all) == (12, 1.0)


def test_text_rule_looks_at_the_nearest_point_only() -> None:
    # The point nearest to 0.1 (0.08) is a miss; a hit lies a little farther away on the other side.
    X = _column(0.13, 0.08, 0.3, 0.52, 0.7, 0.9)
    values = np.array([0.99, 0.2, 1.0, 0.5, 1.0, 0.96])
    assert text_count(EQUAL, X, values) == 3
    assert thesis_score(EQUAL, X, values).found == 4
    # As worded, one hit serves every optimum that has no nearer point.
    assert text_count(EQUAL, _column(0.3), np.array([1.0])) == 5
    assert text_count(EQUAL, np.empty((0, 1)), np.empty(0)) == 0


def test_competition_counts_twice_within_one_wide_peak_and_the_strict_rule_does_not() -> None:
    # sin^6 stays above 0.9 for |dx| < 0.0119: two points 0.02 apart are two seeds at radius 0.01.
    X = _column(0.09, 0.11, 0.3)
    assert np.all(EQUAL(X) > 0.9)
    assert competition_count(EQUAL, X, EQUAL(X), 0.1) == 3
    assert strict_count(EQUAL, X, 0.1) == 2
    # At the tight accuracy only the exact point is left.
    assert competition_count(EQUAL, X, EQUAL(X), 1e-3) == 1
    assert strict_count(EQUAL, X, 1e-3) == 1


def test_points_within_the_niche_radius_are_one_seed() -> None:
    X = _column(0.1, 0.105, 0.3)
    assert competition_count(EQUAL, X, EQUAL(X), 0.1) == 2
    near = np.stack([RASTRIGIN.optima[0], RASTRIGIN.optima[0] + np.array([0.004, 0.0])])
    assert thesis_score(RASTRIGIN, near, RASTRIGIN(near)).found == 1


def test_competition_counts_no_more_than_there_are() -> None:
    X = np.linspace(0.0, 1.0, 2001)[:, None]
    assert competition_count(EQUAL, X, EQUAL(X), 0.1) == 5
    assert strict_count(EQUAL, X, 0.1) == 5


def test_strict_rule_refuses_a_local_optimum_of_nearly_the_same_value() -> None:
    uneven = get_problem("uneven_maxima")
    second = np.linspace(0.2, 0.3, 2001)[:, None]
    x = second[[int(np.argmax(uneven(second)))]]
    assert uneven(x)[0] > 0.9
    assert competition_count(uneven, x, uneven(x), 0.1) == 1
    assert basin(uneven, x[0], 0.1) is None
    assert strict_count(uneven, x, 0.1) == 0
    assert strict_count(uneven, uneven.optima, 1e-3) == 1


@pytest.mark.parametrize("name", ["vincent_2d", "himmelblau", "shubert_2d", "cf4_5d", "vincent_3d"])
def test_the_exact_optima_count_in_full_by_every_rule(name: str) -> None:
    problem = get_problem(name)
    values = problem(problem.optima)
    assert strict_count(problem, problem.optima, 1e-3) == problem.n_optima
    assert competition_count(problem, problem.optima, values, 1e-3) == problem.n_optima
    assert text_count(problem, problem.optima, values) == problem.n_optima


def test_empty_solution_set_holds_nothing() -> None:
    assert strict_count(TRAP, np.empty((0, 1)), 0.1) == 0


def _score(found: int, values: list[float], first: float, last: float) -> RunScore:
    return RunScore(2, found, np.array(values), first, last, np.array([found]))


def test_summary_weighs_values_by_optima_found() -> None:
    summary = summarize([_score(2, [1.0, 3.0], 0.2, 0.4), _score(1, [7.0], 1.0, 1.0), _score(0, [], 1.0, 1.0)])
    assert summary.runs == 3
    assert summary.peak_ratio == pytest.approx(3 / 6)
    assert summary.success_rate == pytest.approx(1 / 3)
    assert summary.speed_text == pytest.approx(2.2 / 3)
    assert summary.speed_code == pytest.approx(2.4 / 3)
    # (2 * mean(1, 3) + 1 * 7) / 3, not the mean of the runs' means.
    assert summary.mean_optimum == pytest.approx(11 / 3)
    assert summary.peak_ratio_sd == pytest.approx(0.5)


def test_summary_without_a_find_or_a_run() -> None:
    assert np.isnan(summarize([_score(0, [], 1.0, 1.0)]).mean_optimum)
    with pytest.raises(InvalidSettingsError, match="at least one run"):
        summarize([])


def test_batch_variance_is_the_population_variance_per_dimension() -> None:
    X = np.array([[9.0, 9.0], [0.0, 0.0], [2.0, 4.0], [1.0, 1.0], [1.0, 1.0], [5.0, 5.0]])
    alone, unfinished = [5], [3, 6]
    variance = mean_batch_variance(X, [[1, 2], [3, 4], alone, unfinished])
    assert variance is not None
    np.testing.assert_allclose(variance, [0.5, 2.0])
    assert mean_batch_variance(X, [alone]) is None


@pytest.mark.parametrize(("X", "y"), [(np.zeros((2, 2)), np.zeros(2)), (np.zeros((2, 1)), np.zeros(3))])
def test_traces_of_wrong_shape_are_refused(X: np.ndarray, y: np.ndarray) -> None:
    with pytest.raises(InvalidSettingsError, match="needs points"):
        thesis_score(TRAP, X, y)
