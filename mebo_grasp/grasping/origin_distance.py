"""Distance from the origin to the nearest facet of a convex hull, compiled.

The search is an expanding polytope (van den Bergen, 2001, in three dimensions): start from a simplex of well-spread
points, take the facet whose plane has the smallest signed distance from the origin, and add the point that is farthest
along its normal, until that facet is one of the hull. If the support h(u), the largest u . x over all points, is not
positive along a facet's normal u, the origin lies outside and the search ends at once.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.polytope import (
    CONVERGED,
    DEGENERATE,
    FLAT,
    FULL,
    MOST_FACETS,
    MOST_POINTS,
    OUTSIDE,
    TOLERANCE,
    Polytope,
    add_point,
    allocate,
    begin,
    guarded,
    look_from,
    plane_of,
    qhull,
    start_from,
)

FloatArray = npt.NDArray[np.float64]

LARGEST_DRIFT = 1e-10
"""How far the offset of the nearest facet may differ from the one computed anew from its points."""
FIRST_FACETS = 1024


@njit(cache=True)
def _nearest_facet(points: FloatArray, capacity: int) -> tuple[float, int]:
    """Return the origin's distance to the hull's nearest facet, and how the search ended."""
    n, d = points.shape
    simplex, inside = np.empty(d + 1, np.int64), np.zeros(d)
    if not begin(points, simplex, inside):
        return 0.0, OUTSIDE
    hull = allocate(n, d, capacity)
    if not start_from(points, simplex, inside, hull):
        return 0.0, DEGENERATE
    for _ in range(4 * n + 16):
        nearest = nearest_plane(hull)
        farthest, support = 0, -np.inf
        for i in range(n):
            height = 0.0
            for k in range(d):
                height += hull.normals[nearest, k] * points[i, k]
            if height > support:
                farthest, support = i, height
        if support <= 0.0:
            return 0.0, OUTSIDE
        if support <= hull.offsets[nearest] + TOLERANCE:
            return confirmed(points, hull, nearest, inside)
        if not add_point(points, farthest, hull, look_from(points, farthest, hull)):
            return 0.0, FULL
    return 0.0, DEGENERATE


@njit(cache=True)
def nearest_plane(hull: Polytope) -> int:
    """Return the facet whose plane has the smallest signed distance from the origin."""
    nearest = -1
    for f in range(hull.used[0]):
        if hull.alive[f] == 1 and (nearest < 0 or hull.offsets[f] < hull.offsets[nearest]):
            nearest = f
    return nearest


@njit(cache=True)
def confirmed(points: FloatArray, hull: Polytope, facet: int, inside: FloatArray) -> tuple[float, int]:
    """Return the distance of a facet's plane, computed anew from its points if they span it well."""
    d = points.shape[1]
    normal = np.empty(d)
    offset, area = plane_of(points, hull.vertices[facet], inside, np.empty((d - 1, d)), normal)
    if area > FLAT and abs(offset - hull.offsets[facet]) > LARGEST_DRIFT:
        return 0.0, DEGENERATE
    return max(hull.offsets[facet], 0.0), CONVERGED


def origin_distance(points: FloatArray) -> float:
    """Return the radius of the largest origin-centred ball in the convex hull of points.

    Args:
        points: shape (n, d), d >= 2; sets larger than ``MOST_POINTS`` are given to Qhull.

    Returns:
        The radius; 0 when the origin lies outside or on the hull, or when the hull is flat.
    """
    contiguous = np.ascontiguousarray(points, dtype=np.float64)
    capacity = FIRST_FACETS
    while len(contiguous) <= MOST_POINTS and capacity <= MOST_FACETS:
        distance, end = guarded(_nearest_facet, contiguous, capacity)
        if end in (CONVERGED, OUTSIDE):
            return float(distance)
        if end == DEGENERATE:
            break
        capacity *= 4
    return _qhull_distance(contiguous)


def _qhull_distance(points: FloatArray) -> float:
    hull = qhull(points)
    return 0.0 if hull is None else max(0.0, float((-hull.equations[:, -1]).min()))
