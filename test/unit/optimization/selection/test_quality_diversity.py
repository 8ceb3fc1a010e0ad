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


@pytest.mark.parametrize("seed", range(5))
def test_with_too_many_combinations_no_single_exchange_makes_the_set_better(seed):
    rng = np.random.default_rng(seed)
    centres = rng.random((12, 2))
    X = np.concatenate([centre + 0.05 * rng.standard_normal((20, 2)) for centre in centres])
    y = rng.random(len(X))
    clusters = list(np.arange(len(X)).reshape(12, 20))
    assert shared.LARGEST_NUMBER_OF_PAIRS < 20**12 * 12**2
    chosen = best_combination(X, y, clusters, 0.3)
    assert sorted(int(row) // 20 for row in chosen) == list(range(12))
    found = qd(X, y, chosen)
    for k, row in enumerate(chosen):
        others = [qd(X, y, [*chosen[:k], other, *chosen[k + 1 :]]) for other in clusters[row // 20]]
        assert max(others) <= found + 1e-9


def test_as_many_clusters_as_vincents_function_has_optima_are_no_trouble():
    rng = np.random.default_rng(0)
    X, y = rng.random((1000, 3)), rng.random(1000)
    clusters = np.array_split(np.arange(1000), 216)
    assert len(best_combination(X, y, clusters, 0.01)) == 216


def test_of_one_cluster_the_best_point_is_taken():
    X, y, _ = problem()
    assert best_combination(X, y, [np.arange(24)], 0.3).tolist() == [int(np.argmax(y))]
