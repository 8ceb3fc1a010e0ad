from itertools import combinations

import numpy as np
import pytest

from mebo_grasp.optimization.selection import explorative
from mebo_grasp.optimization.selection.explorative import most_distant_subset


def total(points):
    return sum(np.linalg.norm(a - b) for a, b in combinations(points, 2))


@pytest.mark.parametrize("size", [2, 3, 4])
def test_no_other_subset_lies_farther_apart(size):
    points = np.random.default_rng(size).random((9, 2))
    chosen = points[most_distant_subset(points, size)]
    assert total(chosen) == pytest.approx(max(total(points[list(s)]) for s in combinations(range(9), size)))


def test_exchange_comes_close_to_enumeration(monkeypatch):
    points = np.random.default_rng(0).random((14, 3))
    exact = total(points[most_distant_subset(points, 4)])
    monkeypatch.setattr(explorative, "MAX_SUBSETS", 1)
    chosen = most_distant_subset(points, 4)
    assert len(set(chosen)) == 4
    assert total(points[chosen]) >= 0.97 * exact


def test_one_of_many_all_of_few():
    points = np.array([[0.0], [0.1], [1.0]])
    assert most_distant_subset(points, 1).tolist() == [2]
    assert most_distant_subset(points, 3).tolist() == [0, 1, 2]
