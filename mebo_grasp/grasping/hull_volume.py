"""Volume of the convex hull of points in n dimensions, compiled: added up while the hull grows point by point."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.polytope import (
    CONVERGED,
    DEGENERATE,
    FULL,
    MOST_FACETS,
    MOST_POINTS,
    add_point,
    allocate,
    begin,
    guarded,
    look_from,
    qhull,
    start_from,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FIRST_FACETS = 4096


@njit(cache=True)
def _farthest_first(points: FloatArray, chosen: IntArray) -> IntArray:
    """Return the other points' indices, each as far as possible from all before it: fewer facets are made in vain."""
    n, d = points.shape
    away, order = np.full(n, np.inf), np.empty(n - len(chosen), np.int64)
    for at in range(n - 1):
        last = chosen[at] if at < len(chosen) else order[at - len(chosen)]
        away[last] = -1.0
        following, farthest = -1, -1.0
        for i in range(n):
            if away[i] < 0.0:
                continue
            distance2 = 0.0
            for k in range(d):
                distance2 += (points[i, k] - points[last, k]) ** 2
            away[i] = min(away[i], distance2)
            if away[i] > farthest:
                following, farthest = i, away[i]
        if at + 1 >= len(chosen):
            order[at + 1 - len(chosen)] = following
    return order


@njit(cache=True)
def _volume(points: FloatArray, capacity: int) -> tuple[float, int]:
    """Return the hull's volume by adding one point after the other, and how it ended."""
    n, d = points.shape
    simplex, inside = np.empty(d + 1, np.int64), np.zeros(d)
    if not begin(points, simplex, inside):
        return 0.0, CONVERGED
    hull = allocate(n, d, capacity)
    if not start_from(points, simplex, inside, hull):
        return 0.0, DEGENERATE
    total = 0.0
    for f in range(d + 1):
        height = hull.offsets[f]
        for k in range(d):
            height -= hull.normals[f, k] * inside[k]
        total += height * hull.areas[f]
    order = _farthest_first(points, simplex)
    for i in order:
        n_seen = look_from(points, i, hull)
        for s in range(n_seen):
            total += hull.heights[hull.seen[s]] * hull.areas[hull.seen[s]]
        # Nothing is asked of the hull after the last point.
        if n_seen > 0 and i != order[-1] and not add_point(points, i, hull, n_seen):
            return 0.0, FULL
    factorial = 1.0
    for k in range(2, d + 1):
        factorial *= k
    return total / factorial, CONVERGED


def hull_volume(points: FloatArray) -> float:
    """Return the volume of the convex hull of points, shape (n, d); 0 when it is flat."""
    contiguous = np.ascontiguousarray(points, dtype=np.float64)
    capacity = FIRST_FACETS
    while len(contiguous) <= MOST_POINTS and capacity <= MOST_FACETS:
        volume, end = guarded(_volume, contiguous, capacity)
        if end == CONVERGED:
            return float(volume)
        if end == DEGENERATE:
            break
        capacity *= 4
    hull = qhull(contiguous)
    return 0.0 if hull is None else float(hull.volume)
