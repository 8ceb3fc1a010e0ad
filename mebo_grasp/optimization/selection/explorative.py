"""Explorative sampling: of many candidates take those that lie farthest apart (thesis 5.2)."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from math import comb

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

MAX_SUBSETS = 20_000
"""Up to this number all subsets are compared; beyond it points are exchanged until nothing improves."""


@cache
def _subsets(n: int, size: int) -> npt.NDArray[np.int64]:
    return np.array(list(combinations(range(n), size)), dtype=np.int64)


def most_distant_subset(candidates: FloatArray, size: int) -> npt.NDArray[np.int64]:
    """Return the subset with the greatest mean pairwise Euclidean distance.

    Args:
        candidates: shape (n, d).
        size: number wanted, at most n.

    Returns:
        Indices, shape (size,), ascending.
    """
    n = len(candidates)
    if size >= n:
        return np.arange(n)
    distances = np.linalg.norm(candidates[:, None, :] - candidates[None, :, :], axis=2)
    if size == 1:
        # One point has no distance within the subset: take the one farthest from the other candidates.
        return np.array([int(np.argmax(distances.sum(axis=1)))])
    if comb(n, size) <= MAX_SUBSETS:
        subsets = _subsets(n, size)
        totals = sum(distances[subsets[:, i], subsets[:, j]] for i, j in combinations(range(size), 2))
        chosen: npt.NDArray[np.int64] = subsets[int(np.argmax(totals))]
        return chosen
    return _exchange(distances, size)


def _exchange(distances: FloatArray, size: int) -> npt.NDArray[np.int64]:
    """Greedy choice, then the best single exchange until none improves."""
    chosen = [int(i) for i in np.unravel_index(int(np.argmax(distances)), distances.shape)]
    while len(chosen) < size:
        gain = distances[:, chosen].sum(axis=1)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
    while True:
        sums = distances[:, chosen].sum(axis=1)
        # gain[i, k]: total distance won by putting candidate i in the place of the k-th chosen point.
        gain = sums[:, None] - distances[:, chosen] - sums[chosen][None, :]
        gain[chosen] = -np.inf
        i, k = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[i, k] <= 1e-12:
            return np.sort(np.array(chosen, dtype=np.int64))
        chosen[int(k)] = int(i)
