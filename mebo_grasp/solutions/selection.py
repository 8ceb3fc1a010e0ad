"""Which M of many solutions to keep: exactly, by the thesis's clusters, or greedily (``diversity``).

Everything here works on plain arrays, for grasps and for any other points alike. Notation: n solutions
with mutual distances D, shape (n, n), and qualities y, shape (n,); M is the size of the set; tau the
minimum distance of diverse solutions.
"""

from __future__ import annotations

import math

import numpy as np
from sklearn.cluster import KMeans

from mebo_grasp.compiling import compiled
from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.quality_diversity import LARGEST_NUMBER_OF_SETS, best_combination, best_first, best_subset
from mebo_grasp.solutions.diversity import IntArray

LARGEST_EXACT = 200
"""Solutions among which ``select_exact`` searches at most."""
RESTARTS = 20
"""Of k-means, each from other first centres."""


def select_exact(distances: FloatArray, qualities: FloatArray, size: int, min_distance: float) -> IntArray:
    """Return the mutually diverse set of at most M solutions whose qualities have the greatest sum.

    Branch and bound over the solutions, best first.

    Args:
        distances: D, shape (n, n), n at most ``LARGEST_EXACT``.
        qualities: y, shape (n,); solutions at or below 0 are left out.
        size: M.
        min_distance: tau.

    Returns:
        Rows, best first.

    Raises:
        InvalidQueryError: there are too many solutions, or the numbers do not fit together.
    """
    n = _check(distances, qualities, size)
    if n > LARGEST_EXACT:
        raise InvalidQueryError(
            f"an exact selection among {n} solutions is too slow, at most {LARGEST_EXACT} are taken; "
            "leave out the worst or select greedily"
        )
    order = np.argsort(-qualities, kind="stable")
    order = order[qualities[order] > 0.0]
    is_diverse = distances[np.ix_(order, order)] >= min_distance
    chosen = _branch_and_bound(is_diverse, qualities[order], min(size, len(order)))
    return order[chosen]


@compiled
def _branch_and_bound(is_diverse: FloatArray, y: FloatArray, size: int) -> IntArray:
    """Return the best set; y is sorted, best first."""
    n = len(y)
    taken, best = np.zeros(size + 1, np.int64), np.zeros(0, np.int64)
    sums = np.zeros(size + 1)
    # blockers[k]: how many of the taken solutions are too near to k.
    blockers = np.zeros(n, np.int64)
    best_sum, depth, candidate = 0.0, 0, 0
    while True:
        while candidate < n and blockers[candidate] > 0:
            candidate += 1
        bound = sums[depth] + _greatest_rest(y, blockers, candidate, size - depth)
        if depth < size and candidate < n and bound > best_sum:
            taken[depth] = candidate
            sums[depth + 1] = sums[depth] + y[candidate]
            for k in range(n):
                blockers[k] += not is_diverse[candidate, k]
            depth += 1
            if sums[depth] > best_sum:
                best_sum, best = sums[depth], taken[:depth].copy()
            candidate += 1
            continue
        if depth == 0:
            return best
        depth -= 1
        for k in range(n):
            blockers[k] -= not is_diverse[taken[depth], k]
        candidate = taken[depth] + 1


@compiled
def _greatest_rest(y: FloatArray, blockers: IntArray, first: int, number: int) -> float:
    """Return the sum of the best solutions that are not blocked, whether or not they go together."""
    total = 0.0
    for k in range(first, len(y)):
        if number == 0:
            break
        if blockers[k] == 0:
            total += y[k]
            number -= 1
    return total


def select_max_qd(distances: FloatArray, qualities: FloatArray, size: int, min_distance: float) -> IntArray:
    """Return the set of M solutions with the greatest QD value, by comparing all sets.

    Args:
        distances: D, shape (n, n).
        qualities: y, shape (n,).
        size: M; with fewer solutions all of them are returned.
        min_distance: tau.

    Returns:
        Rows, best quality first.

    Raises:
        InvalidQueryError: there are more than ``LARGEST_NUMBER_OF_SETS`` sets.
    """
    n = _check(distances, qualities, size)
    m = min(size, n)
    if math.comb(n, m) > LARGEST_NUMBER_OF_SETS:
        raise InvalidQueryError(
            f"{math.comb(n, m)} sets of {m} among {n} solutions are too many to compare, the limit is "
            f"{LARGEST_NUMBER_OF_SETS}; leave out the worst or select by clusters"
        )
    return best_first(best_subset(distances, qualities, m, min_distance), qualities)


def select_by_clusters(
    points: FloatArray,
    distances: FloatArray,
    qualities: FloatArray,
    size: int,
    min_distance: float,
    rng: np.random.Generator,
) -> IntArray:
    """Return the set of M solutions, one of each cluster, with the greatest QD value (thesis, 5.3.2).

    The solutions at or above the ninth decile of quality are divided into M clusters by k-means++; where
    they are too few for that, those above the next decile, and so on. Unlike in the thesis, the worst of
    a cluster are left out where there would be too many combinations; see ``quality_diversity.best_combination``.

    Args:
        points: to be clustered, each dimension normalized to [0, 1], shape (n, d).
        distances: D, shape (n, n), in any unit.
        qualities: y, shape (n,).
        size: M; with fewer distinct solutions all of them are returned.
        min_distance: tau, in the unit of D.
        rng: source of the first centres.

    Returns:
        Rows, best quality first.

    Raises:
        InvalidQueryError: the numbers do not fit together.
    """
    _check(distances, qualities, size)
    if points.ndim != 2 or len(points) != len(qualities):
        raise InvalidQueryError(f"points need shape (n, d) with n = {len(qualities)}, got {points.shape}")
    kept = _best_enough(points, qualities, size)
    if len(np.unique(points[kept], axis=0)) <= size:
        _, first = np.unique(points[kept], axis=0, return_index=True)
        return best_first(kept[first], qualities)
    means = KMeans(size, n_init=RESTARTS, random_state=int(rng.integers(2**31)))
    labels = means.fit_predict(points[kept])
    clusters = [kept[labels == label] for label in range(size)]
    clusters = [cluster for cluster in clusters if len(cluster)]
    return best_combination(distances, qualities, clusters, min_distance)


def _best_enough(points: FloatArray, qualities: FloatArray, size: int) -> IntArray:
    kept = np.arange(len(qualities))
    for decile in range(9, 0, -1):
        kept = np.flatnonzero(qualities >= np.quantile(qualities, decile / 10))
        if len(np.unique(points[kept], axis=0)) >= size:
            return kept
    return np.arange(len(qualities))


def _check(distances: FloatArray, qualities: FloatArray, size: int) -> int:
    n = len(qualities)
    if n < 1 or distances.shape != (n, n):
        raise InvalidQueryError(
            f"{n} qualities need at least one solution and distances of shape ({n}, {n}), got {distances.shape}"
        )
    if size < 1:
        raise InvalidQueryError(f"the size of a set must be at least 1, got {size}")
    if not np.all(np.isfinite(qualities)) or not np.all(np.isfinite(distances)):
        raise InvalidQueryError("qualities and distances must be finite")
    return n
