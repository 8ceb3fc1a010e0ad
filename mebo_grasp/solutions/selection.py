"""Which M of many solutions to keep: exactly, by the thesis's clusters, or greedily (``diversity``).

Everything here works on plain arrays, for grasps and for any other points alike. Notation: n solutions
with mutual distances D, shape (n, n), and qualities y, shape (n,); M is the size of the set; tau the
minimum distance of diverse solutions.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from sklearn.cluster import KMeans

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.diversity import IntArray

LARGEST_EXACT = 200
"""Solutions among which ``select_exact`` searches at most."""
LARGEST_NUMBER_OF_SETS = 5_000_000
"""Sets that ``select_max_qd`` and ``select_by_clusters`` compare at most."""
RESTARTS = 20
"""Of k-means, each from other first centres."""


def select_exact(
    distances: FloatArray, qualities: FloatArray, size: int, min_distance: float
) -> IntArray:
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def qd_of_rows(distances: FloatArray, qualities: FloatArray, rows: IntArray, min_distance: float) -> float:
    """Return the QD value of a small set (thesis, section 5.3.2); see ``diversity.qd_value``."""
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


def select_max_qd(
    distances: FloatArray, qualities: FloatArray, size: int, min_distance: float
) -> IntArray:
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
    return _best_first(_best_subset(distances, qualities, m, min_distance), qualities)


@njit(cache=True, nogil=True)
def _best_subset(distances: FloatArray, qualities: FloatArray, m: int, min_distance: float) -> IntArray:
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
    a cluster are left out where there would be more than ``LARGEST_NUMBER_OF_SETS`` combinations.

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
        return _best_first(kept[first], qualities)
    means = KMeans(size, n_init=RESTARTS, random_state=int(rng.integers(2**31)))
    labels = means.fit_predict(points[kept])
    clusters = [kept[labels == label] for label in range(size)]
    clusters = _limit([_best_first(cluster, qualities) for cluster in clusters if len(cluster)])
    members = np.concatenate(clusters)
    begins = np.cumsum([0, *(len(cluster) for cluster in clusters)])
    rows = _best_combination(distances, qualities, members, begins, min_distance)
    return _best_first(rows, qualities)


def _best_enough(points: FloatArray, qualities: FloatArray, size: int) -> IntArray:
    kept = np.arange(len(qualities))
    for decile in range(9, 0, -1):
        kept = np.flatnonzero(qualities >= np.quantile(qualities, decile / 10))
        if len(np.unique(points[kept], axis=0)) >= size:
            return kept
    return np.arange(len(qualities))


def _limit(clusters: list[IntArray]) -> list[IntArray]:
    """Leave out the last of the largest cluster until there are few enough combinations."""
    while math.prod(len(cluster) for cluster in clusters) > LARGEST_NUMBER_OF_SETS:
        largest = max(range(len(clusters)), key=lambda k: len(clusters[k]))
        clusters[largest] = clusters[largest][:-1]
    return clusters


@njit(cache=True, nogil=True)
def _best_combination(
    distances: FloatArray, qualities: FloatArray, members: IntArray, begins: IntArray, min_distance: float
) -> IntArray:
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


def _best_first(rows: IntArray, qualities: FloatArray) -> IntArray:
    return rows[np.argsort(-qualities[rows], kind="stable")]


def _check(distances: FloatArray, qualities: FloatArray, size: int) -> int:
    n = len(qualities)
    if n < 1 or distances.shape != (n, n):
        raise InvalidQueryError(
            f"{n} qualities need at least one solution and distances of shape ({n}, {n}), "
            f"got {distances.shape}"
        )
    if size < 1:
        raise InvalidQueryError(f"the size of a set must be at least 1, got {size}")
    if not np.all(np.isfinite(qualities)) or not np.all(np.isfinite(distances)):
        raise InvalidQueryError("qualities and distances must be finite")
    return n
