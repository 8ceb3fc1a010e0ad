"""A convex polytope that grows point by point in n dimensions, compiled.

Notation
    points: (n, d) array, the generators of the polytope
    facet:  d point indices; unit outward normal u and offset o, so that u . x <= o holds inside
    ridge:  what two facets share, d - 1 points; a facet's neighbour k lies across the ridge without its vertex k

A point is added as in any beneath-beyond hull: the facets that see it give way to a cone from it to their
horizon. The plane of a new facet turns about its ridge, so its normal is a positive combination of the normals
on the two sides of the horizon; no system of equations is solved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import ConvexHull, QhullError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
KeyArray = npt.NDArray[np.uint64]

FLAT = 1e-9
"""A point set thinner than this in some direction spans no volume; wrenches are of the order of 1."""
TOLERANCE = 1e-11
"""How far a point must lie beyond a facet to be taken for outside."""
MOST_POINTS = 1 << 12
"""Larger sets go to Qhull."""
MOST_FACETS = 1 << 20

CONVERGED, OUTSIDE, DEGENERATE, FULL = 0, 1, 2, 3


class Polytope(NamedTuple):
    """A growing polytope; rows of facets that are no longer part of it are used again.

    Attributes:
        vertices, neighbors: (capacity, d) of each facet.
        normals, offsets: its plane.
        areas: (d - 1)! times its area, where wanted.
        heights: of the point being added above each plane.
        alive: whether a row is in use.
        free, seen, fresh: rows that are free, that see the point being added, that were just made.
        keys: (n,) a random number a point; the sum over a ridge's points tells it from others.
        slot_key, slot_owner: hash table of ridges of new facets.
        used: rows ever used, rows free.
    """

    vertices: npt.NDArray[np.int32]
    neighbors: npt.NDArray[np.int32]
    normals: FloatArray
    offsets: FloatArray
    areas: FloatArray
    heights: FloatArray
    alive: IntArray
    free: IntArray
    seen: IntArray
    fresh: IntArray
    keys: KeyArray
    slot_key: KeyArray
    slot_owner: IntArray
    used: IntArray


@njit(cache=True)
def _initial_simplex(points: FloatArray, simplex: IntArray) -> bool:
    """Pick d + 1 points, each as far as possible from the flat through those before it."""
    n, d = points.shape
    rest = points.copy()
    first, best = 0, -1.0
    for i in range(n):
        norm = 0.0
        for k in range(d):
            norm += points[i, k] * points[i, k]
        if norm > best:
            first, best = i, norm
    simplex[0] = first
    for i in range(n):
        for k in range(d):
            rest[i, k] -= points[first, k]
    for level in range(1, d + 1):
        chosen, best = -1, FLAT * FLAT
        for i in range(n):
            norm = 0.0
            for k in range(d):
                norm += rest[i, k] * rest[i, k]
            if norm > best:
                chosen, best = i, norm
        if chosen < 0:
            return False
        simplex[level] = chosen
        axis = rest[chosen] / np.sqrt(best)
        for i in range(n):
            along = 0.0
            for k in range(d):
                along += rest[i, k] * axis[k]
            for k in range(d):
                rest[i, k] -= along * axis[k]
    return True


@njit(cache=True)
def plane_of(
    points: FloatArray,
    vertices: npt.NDArray[np.int32],
    inside: FloatArray,
    work: FloatArray,
    normal: FloatArray,
) -> tuple[float, float]:
    """Write the unit normal of a facet, pointing away from ``inside``; return its offset and its pivot product.

    The pivot product is (d - 1)! times the facet's area; 0 means that the facet is degenerate.
    """
    d = points.shape[1]
    for r in range(d - 1):
        for k in range(d):
            work[r, k] = points[vertices[r + 1], k] - points[vertices[0], k]
    # Complete pivoting keeps thin facets accurate.
    free = _eliminate(work, normal)
    norm = 0.0
    for k in range(d):
        norm += normal[k] * normal[k]
    norm = np.sqrt(norm)
    if free == 0.0 or norm == 0.0:
        return 0.0, 0.0
    offset, side = 0.0, 0.0
    for k in range(d):
        normal[k] /= norm
        offset += normal[k] * points[vertices[0], k]
        side += normal[k] * inside[k]
    if side > offset:
        offset = -offset
        for k in range(d):
            normal[k] = -normal[k]
    return offset, free * norm


@njit(cache=True)
def _eliminate(work: FloatArray, normal: FloatArray) -> float:
    """Solve ``work @ normal = 0`` with one coordinate of ``normal`` set to 1; return the product of pivots."""
    rows, d = work.shape
    column = np.empty(d, np.int64)
    for k in range(d):
        column[k] = k
    product = 1.0
    for r in range(rows):
        best, row, at = 0.0, r, r
        for i in range(r, rows):
            for k in range(r, d):
                size = abs(work[i, column[k]])
                if size > best:
                    best, row, at = size, i, k
        if best < 1e-14:
            return 0.0
        column[r], column[at] = column[at], column[r]
        if row != r:
            for k in range(d):
                work[r, k], work[row, k] = work[row, k], work[r, k]
        pivot = work[r, column[r]]
        product *= abs(pivot)
        for i in range(r + 1, rows):
            factor = work[i, column[r]] / pivot
            if factor != 0.0:
                for k in range(r, d):
                    work[i, column[k]] -= factor * work[r, column[k]]
    normal[column[d - 1]] = 1.0
    for r in range(rows - 1, -1, -1):
        total = 0.0
        for k in range(r + 1, d):
            total += work[r, column[k]] * normal[column[k]]
        normal[column[r]] = -total / work[r, column[r]]
    return product


@njit(cache=True)
def _random_key(i: int) -> np.uint64:
    """Return the i-th number of a fixed random sequence (splitmix64, Steele et al., 2014)."""
    x = np.uint64(i + 1) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit(cache=True)
def allocate(n: int, d: int, capacity: int) -> Polytope:
    """Allocate a polytope with room for so many facets, of n points in d dimensions."""
    keys = np.empty(n, np.uint64)
    for i in range(n):
        keys[i] = _random_key(i)
    slots = 16
    while slots < 2 * capacity * d:
        slots *= 2
    return Polytope(
        np.empty((capacity, d), np.int32),
        np.empty((capacity, d), np.int32),
        np.empty((capacity, d)),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(capacity),
        np.zeros(capacity, np.int64),
        np.empty(capacity, np.int64),
        np.empty(capacity, np.int64),
        np.empty(capacity, np.int64),
        keys,
        np.empty(slots, np.uint64),
        np.empty(slots, np.int64),
        np.zeros(2, np.int64),
    )


@njit(cache=True)
def start_from(points: FloatArray, simplex: IntArray, inside: FloatArray, hull: Polytope) -> bool:
    """Set up the d + 1 facets of a simplex; False if one is degenerate."""
    d = points.shape[1]
    work = np.empty((d - 1, d))
    for f in range(d + 1):
        at = 0
        for k in range(d + 1):
            if k != f:
                hull.vertices[f, at] = simplex[k]
                hull.neighbors[f, at] = k
                at += 1
        hull.alive[f] = 1
        hull.offsets[f], hull.areas[f] = plane_of(points, hull.vertices[f], inside, work, hull.normals[f])
        if hull.areas[f] == 0.0:
            return False
    hull.used[0] = d + 1
    return True


@njit(cache=True)
def look_from(points: FloatArray, point: int, hull: Polytope) -> int:
    """Note the height of a point above every facet; return how many see it, listed in ``hull.seen``."""
    d = points.shape[1]
    n_seen = 0
    for f in range(hull.used[0]):
        if hull.alive[f] == 0:
            continue
        height = -hull.offsets[f]
        for k in range(d):
            height += hull.normals[f, k] * points[point, k]
        hull.heights[f] = height
        if height > TOLERANCE:
            hull.seen[n_seen] = f
            n_seen += 1
    return n_seen


@njit(cache=True, inline="always")
def _make_facet(points: FloatArray, point: int, hull: Polytope, c: int, f: int, k: int) -> None:
    """Write facet c from a point to the ridge across which facet f, which sees it, has neighbour k, which does not."""
    d = points.shape[1]
    g = hull.neighbors[f, k]
    above, below = hull.heights[f], max(-hull.heights[g], 0.0)
    norm = 0.0
    for m in range(d):
        hull.normals[c, m] = above * hull.normals[g, m] + below * hull.normals[f, m]
        norm += hull.normals[c, m] ** 2
        hull.vertices[c, m] = hull.vertices[f, m]
    scale = 1.0 / np.sqrt(norm)
    back = 0
    for m in range(d):
        if hull.neighbors[g, m] == f:
            back = m
    offset, far_f, far_g = 0.0, 0.0, 0.0
    for m in range(d):
        hull.normals[c, m] *= scale
        offset += hull.normals[c, m] * points[point, m]
        far_f += hull.normals[c, m] * points[hull.vertices[f, k], m]
        far_g += hull.normals[c, m] * points[hull.vertices[g, back], m]
    hull.offsets[c] = offset
    # The simplex of facet and opposite point has one volume, whichever of its facets is taken for the base.
    far_f, far_g = offset - far_f, offset - far_g
    if far_f >= far_g:
        hull.areas[c] = hull.areas[f] * above / far_f if far_f > 0.0 else 0.0
    else:
        hull.areas[c] = hull.areas[g] * below / far_g
    hull.vertices[c, k] = point
    hull.neighbors[c, k] = g
    hull.neighbors[g, back] = c
    hull.alive[c] = 1


@njit(cache=True)
def _join(points: FloatArray, point: int, hull: Polytope, n_fresh: int) -> None:
    """Make the new facets neighbours of one another: two share each ridge that holds the point."""
    d = points.shape[1]
    slots = 16
    while slots < 2 * n_fresh * d:
        slots *= 2
    mask = np.uint64(slots - 1)
    hull.slot_owner[:slots] = -1
    for i in range(n_fresh):
        c = hull.fresh[i]
        total = np.uint64(0)
        for m in range(d):
            total += hull.keys[hull.vertices[c, m]]
        for m in range(d):
            if hull.vertices[c, m] == point:
                continue
            key = total - hull.keys[hull.vertices[c, m]]
            at = key & mask
            while hull.slot_owner[at] >= 0 and hull.slot_key[at] != key:
                at = (at + np.uint64(1)) & mask
            owner = hull.slot_owner[at]
            if owner < 0:
                hull.slot_key[at] = key
                hull.slot_owner[at] = c * d + m
            else:
                hull.neighbors[c, m] = owner // d
                hull.neighbors[owner // d, owner % d] = c


@njit(cache=True)
def add_point(points: FloatArray, point: int, hull: Polytope, n_seen: int) -> bool:
    """Replace the facets that see a point by the cone from it to their horizon; False if there is no room."""
    d = points.shape[1]
    n_fresh = 0
    for s in range(n_seen):
        f = hull.seen[s]
        for k in range(d):
            if hull.heights[hull.neighbors[f, k]] > TOLERANCE:
                continue
            if hull.used[1] > 0:
                hull.used[1] -= 1
                c = hull.free[hull.used[1]]
            elif hull.used[0] < hull.offsets.shape[0]:
                c = hull.used[0]
                hull.used[0] += 1
            else:
                return False
            # A row made now must not be taken for one that sees the point.
            hull.heights[c] = 0.0
            hull.fresh[n_fresh] = c
            n_fresh += 1
            _make_facet(points, point, hull, c, f, k)
    _join(points, point, hull, n_fresh)
    for s in range(n_seen):
        f = hull.seen[s]
        hull.alive[f] = 0
        hull.free[hull.used[1]] = f
        hull.used[1] += 1
    return True


@njit(cache=True)
def begin(points: FloatArray, simplex: IntArray, inside: FloatArray) -> bool:
    """Choose the initial simplex and a point inside it; False if the points are flat."""
    if points.shape[0] < simplex.shape[0] or not _initial_simplex(points, simplex):
        return False
    for i in range(simplex.shape[0]):
        inside += points[simplex[i]] / simplex.shape[0]
    return True


def guarded(
    search: Callable[[FloatArray, int], tuple[float, int]], points: FloatArray, capacity: int
) -> tuple[float, int]:
    """Search; points so degenerate that a facet has no area divide by zero there and are left to Qhull."""
    try:
        return search(points, capacity)
    except ZeroDivisionError:
        return 0.0, DEGENERATE


def qhull(points: FloatArray) -> ConvexHull | None:
    """Return Qhull's hull of points, shape (n, d); None if they are flat."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None
