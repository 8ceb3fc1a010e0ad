"""Largest origin-centred ball in the sum of the contacts' wrench sets: epsilon when each contact has its own limit.

With every contact force limited by itself (L-infinity; Ferrari and Canny, 1992), the wrenches that a grasp can
apply are the Minkowski sum of the hulls of {0} and each contact's edge wrenches. Its corners are too many to list
((m + 1) to the power of n), but its support is cheap: h(u) = sum over contacts of max(0, max over edges u . w).
The expanding polytope of ``origin_distance`` needs no more: it asks for the corner farthest along a facet's normal.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.origin_distance import confirmed, nearest_plane
from mebo_grasp.grasping.polytope import (
    CONVERGED,
    DEGENERATE,
    FULL,
    MOST_FACETS,
    OUTSIDE,
    TOLERANCE,
    add_point,
    allocate,
    begin,
    look_from,
    start_from,
)

FloatArray = npt.NDArray[np.float64]

MOST_CORNERS = 8192
FIRST_FACETS = 4096
JOGGLE = 1e-10
"""By how much wrenches are moved where they are too regular for the search; wrenches are of the order of 1."""


@njit(cache=True)
def _corner(sets: FloatArray, direction: FloatArray, out: FloatArray) -> float:
    """Write the corner of the sum that is farthest along a direction; return how far that is."""
    contacts, edges, d = sets.shape
    out[:] = 0.0
    total = 0.0
    for i in range(contacts):
        best, chosen = 0.0, -1
        for j in range(edges):
            along = 0.0
            for k in range(d):
                along += direction[k] * sets[i, j, k]
            if along > best:
                best, chosen = along, j
        if chosen >= 0:
            total += best
            for k in range(d):
                out[k] += sets[i, chosen, k]
    return total


@njit(cache=True)
def _first_corners(sets: FloatArray, points: FloatArray) -> int:
    """Write the corners farthest along each axis, both ways, and all single wrenches; return how many."""
    contacts, edges, d = sets.shape
    count = 0
    axis = np.zeros(d)
    for k in range(d):
        for sign in (-1.0, 1.0):
            axis[:] = 0.0
            axis[k] = sign
            _corner(sets, axis, points[count])
            count += 1
    for i in range(contacts):
        for j in range(edges):
            if count < points.shape[0] // 2:
                points[count] = sets[i, j]
                count += 1
    return count


@njit(cache=True)
def _nearest_facet_of_sum(sets: FloatArray, capacity: int) -> tuple[float, int]:
    """Return the origin's distance to the nearest facet of the sum, and how the search ended."""
    d = sets.shape[2]
    points = np.zeros((MOST_CORNERS, d))
    count = _first_corners(sets, points)
    simplex, inside = np.empty(d + 1, np.int64), np.zeros(d)
    if not begin(points[:count], simplex, inside):
        return 0.0, OUTSIDE
    hull = allocate(MOST_CORNERS, d, capacity)
    if not start_from(points, simplex, inside, hull):
        return 0.0, DEGENERATE
    while count < MOST_CORNERS:
        nearest = nearest_plane(hull)
        support = _corner(sets, hull.normals[nearest], points[count])
        if support <= 0.0:
            return 0.0, OUTSIDE
        if support <= hull.offsets[nearest] + TOLERANCE:
            return confirmed(points, hull, nearest, inside)
        if not add_point(points, count, hull, look_from(points, count, hull)):
            return 0.0, FULL
        count += 1
    return 0.0, FULL


def sum_origin_distance(sets: FloatArray) -> float:
    """Return the radius of the largest origin-centred ball in the sum of the hulls of {0} and each set.

    Args:
        sets: shape (contacts, edges, d).

    Returns:
        The radius; 0 when the origin lies on the sum's surface or the sum is flat.

    Raises:
        RuntimeError: the nearest facet was not found, be it among ``MOST_CORNERS`` corners.
    """
    contiguous = np.ascontiguousarray(sets, dtype=np.float64)
    if contiguous.shape[0] == 0:
        return 0.0
    # Facets without area divide by zero, as contacts placed with great regularity give them: those are moved apart.
    apart = JOGGLE * np.cos(np.arange(contiguous.size, dtype=np.float64)).reshape(contiguous.shape)
    for moved in (contiguous, contiguous + apart):
        capacity = FIRST_FACETS
        while capacity <= MOST_FACETS:
            try:
                distance, end = _nearest_facet_of_sum(moved, capacity)
            except ZeroDivisionError:
                break
            if end in (CONVERGED, OUTSIDE):
                # Every sum holds the origin; on its surface rounding leaves about 1e-16.
                return float(distance) if distance > TOLERANCE else 0.0
            if end == DEGENERATE:
                break
            capacity *= 4
    raise RuntimeError(f"no nearest facet of the sum of {contiguous.shape[0]} contacts among {MOST_CORNERS} corners")
