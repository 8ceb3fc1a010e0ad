"""The best points that keep a distance: what any method can answer from its observations."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from mebo_grasp.grasp import FloatArray

DEFAULT_SHARE = 0.1
"""Default smallest distance as a share of the unit cube's diagonal."""


def greedy_diverse_set(X: FloatArray, y: FloatArray, size: int | None, min_distance: float) -> npt.NDArray[np.int64]:
    """Walk through the points from the best down and keep each that is far enough from those kept.

    Args:
        X: points, shape (n, d).
        y: values, shape (n,), larger is better; of equal values the earlier comes first.
        size: largest number kept; None for no limit.
        min_distance: smallest Euclidean distance between two kept points, units of X.

    Returns:
        Indices of the kept points, best first.
    """
    order = np.argsort(-y, kind="stable")
    free = np.ones(len(y), dtype=bool)
    kept: list[int] = []
    for index in order:
        if size is not None and len(kept) >= size:
            break
        if free[index]:
            kept.append(int(index))
            free &= np.linalg.norm(X - X[index], axis=1) >= min_distance
    return np.array(kept, dtype=np.int64)


def slot_values(X: FloatArray, y: FloatArray, candidates: FloatArray, size: int, min_distance: float) -> FloatArray:
    """Value that each candidate has to exceed to improve the greedy diverse set, shape (m,).

    That is the best of the set nearer to it than ``min_distance``, which it would displace, or the last one of a
    full set if that is higher. Better points nearby that are no part of the set do not count.

    Args:
        X: points, shape (n, d), n at least 1.
        y: values, shape (n,).
        candidates: shape (m, d), units of X.
        size: number of points wanted.
        min_distance: smallest distance between two of the set, units of X.
    """
    kept = greedy_diverse_set(X, y, size, min_distance)
    least = float(y[kept[-1]]) if len(kept) >= size else float(np.min(y))
    near = cdist(candidates, X[kept]) < min_distance
    displaced = np.max(np.where(near, y[kept], least), axis=1)
    return np.maximum(displaced, least)
