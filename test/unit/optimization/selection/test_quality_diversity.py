from itertools import product

import numpy as np
import pytest

from mebo_grasp import quality_diversity as shared
from mebo_grasp.optimization.selection.quality_diversity import best_combination
from mebo_grasp.solutions.diversity import qd_value


def problem():
    rng = np.random.default_rng(0)
    X, y = rng.random((24, 2)), rng.standard_normal(24)
    return X, y, [np.arange(0, 8), np.arange(8, 16), np.arange(16, 24)]


def qd(X, y, rows):
    """QD by another way, from the worst value observed."""
    rows = list(rows)
    D = np.linalg.norm(X[rows][:, None] - X[rows][None], axis=2)
    return qd_value(D, y[rows] - y.min(), 0.3)


def test_no_other_combination_is_better():
    X, y, clusters = problem()
    chosen = best_combination(X, y, clusters, 0.3)
    best = max(qd(X, y, rows) for rows in product(*clusters))
    assert qd(X, y, chosen) == pytest.approx(best)
    assert np.all(np.diff(y[chosen]) <= 0)
    assert sorted(int(row) // 8 for row in chosen) == [0, 1, 2]


def test_with_too_many_combinations_the_worst_of_the_largest_clusters_are_left_out(monkeypatch):
    X, y, clusters = problem()
    monkeypatch.setattr(shared, "LARGEST_NUMBER_OF_PAIRS", 4 * 4 * 4 * 3 * 3)
    kept = [cluster[np.argsort(-y[cluster])][:4] for cluster in clusters]
    best = max(qd(X, y, rows) for rows in product(*kept))
    assert qd(X, y, best_combination(X, y, clusters, 0.3)) == pytest.approx(best)


def test_as_many_clusters_as_vincents_function_has_optima_are_no_trouble():
    rng = np.random.default_rng(0)
    X, y = rng.random((1000, 3)), rng.random(1000)
    clusters = np.array_split(np.arange(1000), 216)
    assert len(best_combination(X, y, clusters, 0.01)) == 216


def test_of_one_cluster_the_best_point_is_taken():
    X, y, _ = problem()
    assert best_combination(X, y, [np.arange(24)], 0.3).tolist() == [int(np.argmax(y))]
