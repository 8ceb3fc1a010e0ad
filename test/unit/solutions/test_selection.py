"""Selections of sets against all sets, compared one by one."""

import itertools

import numpy as np
import pytest

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.quality_diversity import qd_of_rows
from mebo_grasp.solutions.diversity import PoseMetric, qd_value, select_diverse
from mebo_grasp.solutions.selection import (
    select_by_clusters,
    select_exact,
    select_max_qd,
)


def random_problem(seed: int, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (n, 2))
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return points, distances, rng.uniform(0.01, 1.0, n)


@pytest.mark.parametrize("seed", range(30))
def test_the_exact_selection_has_the_greatest_sum_of_all_diverse_sets(seed: int) -> None:
    _, D, y = random_problem(seed, 9)
    tau, size = 0.4, 3
    best = max(
        (
            rows
            for m in range(1, size + 1)
            for rows in itertools.combinations(range(9), m)
            if all(D[i, k] >= tau for i, k in itertools.combinations(rows, 2))
        ),
        key=lambda rows: y[list(rows)].sum(),
    )
    chosen = select_exact(D, y, size, tau)
    assert sorted(chosen.tolist()) == sorted(best)
    assert np.all(np.diff(y[chosen]) <= 0)


def test_the_exact_selection_beats_the_greedy_one_where_the_best_blocks_two() -> None:
    positions = np.array([[-0.05, 0.0, 0.0], [0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    y = np.array([0.8, 0.9, 0.8])
    metric = PoseMetric()
    D = metric.pairwise(positions, quaternions)
    assert select_diverse(positions, quaternions, y, 2, 0.08, metric).tolist() == [1]
    assert sorted(select_exact(D, y, 2, 0.08).tolist()) == [0, 2]


def test_two_hundred_solutions_are_selected_exactly() -> None:
    _, D, y = random_problem(1, 200)
    chosen = select_exact(D, y, 4, 0.2)
    assert len(chosen) == 4
    off_diagonal = D[np.ix_(chosen, chosen)][~np.eye(4, dtype=bool)]
    assert off_diagonal.min() >= 0.2


@pytest.mark.parametrize("seed", range(20))
def test_the_best_qd_is_the_best_of_all_sets(seed: int) -> None:
    _, D, y = random_problem(seed, 8)
    best = max(
        itertools.combinations(range(8), 3),
        key=lambda r: qd_value(D[np.ix_(r, r)], y[list(r)], 0.3),
    )
    chosen = select_max_qd(D, y, 3, 0.3)
    assert sorted(chosen.tolist()) == sorted(best)
    rows = np.array(best)
    assert qd_of_rows(D, y, rows, 0.3) == pytest.approx(qd_value(D[np.ix_(rows, rows)], y[rows], 0.3))


@pytest.mark.parametrize("linked", [True, False])
def test_both_qd_values_count_chains_as_one_solution(linked: bool) -> None:
    places = np.array([0.0, 0.15, 0.3, 0.42 if linked else 0.9])
    D = np.abs(places[:, None] - places[None])
    y = np.array([0.5, 0.6, 0.7, 0.8])
    for order in itertools.permutations(range(4)):
        rows = np.array(order)
        assert qd_of_rows(D, y, rows, 0.2) == pytest.approx(qd_value(D, y, 0.2))


def test_clusters_give_one_solution_each_and_the_best_combination_of_them() -> None:
    rng = np.random.default_rng(3)
    centres = np.array([[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]])
    points = np.concatenate([c + rng.uniform(-0.05, 0.05, (4, 2)) for c in centres])
    D = np.linalg.norm(points[:, None] - points[None], axis=2)
    y = np.concatenate([rng.uniform(0.9, 1.0, 12)])
    poor = rng.uniform(0, 1, (12 * 4, 2))  # so that the twelve make up the best two deciles
    points_all = np.concatenate([points, poor])
    D_all = np.linalg.norm(points_all[:, None] - points_all[None], axis=2)
    y_all = np.concatenate([y, rng.uniform(0.0, 0.5, len(poor))])
    top = np.flatnonzero(y_all >= np.quantile(y_all, 0.9))
    chosen = select_by_clusters(points_all, D_all, y_all, 3, 0.2, np.random.default_rng(0))
    assert set(chosen) <= set(top)
    by_cluster = [[i for i in top if i // 4 == cluster] for cluster in range(3)]
    best = max(
        itertools.product(*by_cluster),
        key=lambda r: qd_value(D[np.ix_(r, r)], y[list(r)], 0.2),
    )
    assert sorted(chosen.tolist()) == sorted(best)


def test_fewer_solutions_than_wanted_are_all_returned() -> None:
    points, D, y = random_problem(5, 2)
    for rows in (
        select_exact(D, y, 4, 0.0),
        select_max_qd(D, y, 4, 0.0),
        select_by_clusters(points, D, y, 4, 0.0, np.random.default_rng(0)),
    ):
        assert sorted(rows.tolist()) == [0, 1]


def test_the_same_seed_gives_the_same_set() -> None:
    points, D, y = random_problem(6, 200)
    one, other = (select_by_clusters(points, D, y, 4, 0.1, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_what_is_too_large_or_does_not_fit_is_refused() -> None:
    _, D, y = random_problem(0, 201)
    with pytest.raises(InvalidQueryError, match="at most 200"):
        select_exact(D, y, 4, 0.1)
    with pytest.raises(InvalidQueryError, match="too many"):
        select_max_qd(D, y, 4, 0.1)
    with pytest.raises(InvalidQueryError, match="shape"):
        select_exact(D[:5], y[:5], 2, 0.1)
    with pytest.raises(InvalidQueryError, match="at least 1"):
        select_exact(D[:5, :5], y[:5], 0, 0.1)
    with pytest.raises(InvalidQueryError, match="finite"):
        select_exact(D[:5, :5], y[:5] * np.nan, 2, 0.1)
