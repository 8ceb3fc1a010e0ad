from itertools import product

import numpy as np
import pytest

from mebo_grasp.optimization.selection import quality_diversity as qd
from mebo_grasp.optimization.selection.quality_diversity import best_combination, quality_diversity


def test_quality_diversity_by_hand():
    X = np.array([[0.0], [1.0], [4.0]])
    quality = np.array([3.0, 2.0, 1.0])
    # Nearest distances 1, 1, 3: mean 5/3; least 1 + mean 2 = 3. With tau 2 the second clashes with the first.
    sets = np.array([[0, 1, 2]])
    assert quality_diversity(X, quality, sets, 0.5)[0] == pytest.approx(3 * (5 / 3) * 3)
    assert quality_diversity(X, quality, sets, 2.0)[0] == pytest.approx(2 * (5 / 3) * 3)


def problem():
    rng = np.random.default_rng(0)
    X, y = rng.random((24, 2)), rng.standard_normal(24)
    return X, y, [np.arange(0, 8), np.arange(8, 16), np.arange(16, 24)]


def test_no_other_combination_is_better():
    X, y, clusters = problem()
    chosen = best_combination(X, y, clusters, 0.3)
    sets = np.array(list(product(*clusters)))
    best = quality_diversity(X, y - y.min(), sets, 0.3).max()
    assert quality_diversity(X, y - y.min(), chosen[None], 0.3)[0] == pytest.approx(best)
    assert np.all(np.diff(y[chosen]) <= 0)


def test_exchange_is_close_to_enumeration(monkeypatch):
    X, y, clusters = problem()
    exact = quality_diversity(X, y - y.min(), best_combination(X, y, clusters, 0.3)[None], 0.3)[0]
    monkeypatch.setattr(qd, "MAX_COMBINATIONS", 1)
    found = quality_diversity(X, y - y.min(), best_combination(X, y, clusters, 0.3)[None], 0.3)[0]
    assert 0.8 * exact <= found <= exact * (1 + 1e-12)
