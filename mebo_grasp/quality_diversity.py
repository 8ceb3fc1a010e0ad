"""Which of many sets has the greatest QD value (thesis, section 5.3.2): for grasps and any other points alike.

Notation: n solutions with mutual distances D, shape (n, n), and qualities y, shape (n,), of at least 0; M is the size
of the set; tau the minimum distance of diverse solutions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mebo_grasp.compiling import compiled
from mebo_grasp.grasp import FloatArray

IndexArray = npt.NDArray[np.int64]

LARGEST_NUMBER_OF_SETS = 5_000_000
"""Sets of the thesis's size, four, that are compared at most: a fraction of a second."""
LARGEST_NUMBER_OF_PAIRS = LARGEST_NUMBER_OF_SETS * 4 * 4
"""The same for sets of any size: a set of M has M * M distances to look at."""


def best_combination(
    distances: FloatArray, qualities: FloatArray, clusters: Sequence[IndexArray], min_distance: float
) -> IndexArray:
    """Return the set of one solution of each cluster that has the greatest QD value.

    All combinations are compared; where that would mean more than ``LARGEST_NUMBER_OF_PAIRS`` distances, the worst of
    the largest clusters are left out.

    Args:
        distances: D, shape (n, n).
        qualities: y, shape (n,).
        clusters: rows of each cluster's members, none empty.
        min_distance: tau, in the unit of D.

    Returns:
        Rows, best quality first.
    """
    kept = _limit([best_first(cluster, qualities) for cluster in clusters])
    begins = np.cumsum([0, *(len(cluster) for cluster in kept)])
    rows = _best_combination(distances, qualities, np.concatenate(kept), begins, min_distance)
    return best_first(rows, qualities)


def _limit(clusters: list[IndexArray]) -> list[IndexArray]:
    """Leave out the last of the largest cluster until there are few enough combinations."""
    most = LARGEST_NUMBER_OF_PAIRS // len(clusters) ** 2
    while math.prod(len(cluster) for cluster in clusters) > max(most, 1):
        largest = max(range(len(clusters)), key=lambda k: len(clusters[k]))
        clusters[largest] = clusters[largest][:-1]
    return clusters


@compiled
def qd_of_rows(distances: FloatArray, qualities: FloatArray, rows: IndexArray, min_distance: float) -> float:
    """Return the QD value of a small set (thesis, section 5.3.2); see ``solutions.diversity.qd_value``."""
    m = len(rows)
    group = np.arange(m)
    nearest = np.full(m, np.inf)
    total, least = 0.0, np.inf
    for i in range(m):
        total += qualities[rows[i]]
        least = min(least, qualities[rows[i]])
        for k in range(m):
            if k == i:
                continue
            distance = distances[rows[i], rows[k]]
            nearest[i] = min(nearest[i], distance)
            if distance < min_distance and group[i] != group[k]:
                old, new = max(group[i], group[k]), min(group[i], group[k])
                group[group == old] = new
    if m < 2:
        return 0.0
    diverse = 0
    for i in range(m):
        diverse += group[i] == i
    return float(diverse * np.mean(nearest) * (least + total / m))


@compiled
def best_subset(distances: FloatArray, qualities: FloatArray, m: int, min_distance: float) -> IndexArray:
    """Return the rows of the set of m solutions with the greatest QD value, of all such sets."""
    n = len(qualities)
    rows = np.arange(m)
    best, best_value = rows.copy(), -np.inf
    while True:
        value = qd_of_rows(distances, qualities, rows, min_distance)
        if value > best_value:
            best_value, best = value, rows.copy()
        i = m - 1
        while i >= 0 and rows[i] == n - m + i:
            i -= 1
        if i < 0:
            return best
        rows[i] += 1
        for k in range(i + 1, m):
            rows[k] = rows[k - 1] + 1


@compiled
def _best_combination(
    distances: FloatArray, qualities: FloatArray, members: IndexArray, begins: IndexArray, min_distance: float
) -> IndexArray:
    m = len(begins) - 1
    place = begins[:m].copy()
    best, best_value = members[place], -np.inf
    while True:
        value = qd_of_rows(distances, qualities, members[place], min_distance)
        if value > best_value:
            best_value, best = value, members[place]
        i = m - 1
        while i >= 0 and place[i] == begins[i + 1] - 1:
            place[i] = begins[i]
            i -= 1
        if i < 0:
            return best
        place[i] += 1


def best_first(rows: IndexArray, qualities: FloatArray) -> IndexArray:
    """Return rows in the order of their qualities."""
    return rows[np.argsort(-qualities[rows], kind="stable")]
