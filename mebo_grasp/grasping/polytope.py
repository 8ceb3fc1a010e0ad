"""Nearest facet and volume of the convex hull of points in n dimensions, compiled.

Notation
    points: (n, d) array, the generators of the polytope
    facet:  d point indices; unit outward normal u and offset o, so that u . x <= o holds inside
    h(u):   support, the largest u . x over all points

The search for the nearest facet is an expanding polytope (van den Bergen, 2001, in three dimensions): start
from a simplex of well-spread points, take the facet whose plane has the smallest signed distance from the
origin, and add the point that is farthest along its normal, until that facet is one of the hull. If the
support along a facet's normal is not positive, the origin lies outside and the search ends at once.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import ConvexHull, QhullError

FloatArray = npt.NDArray[np.float64]

FLAT = 1e-9
"""A point set thinner than this in some direction spans no volume; wrenches are of the order of 1."""
TOLERANCE = 1e-11
"""How far a point must lie beyond a facet to be taken for outside."""
INDEX_BITS = 10
MOST_POINTS = 1 << INDEX_BITS
"""Ridges are told apart by a key of up to 6 indices of this many bits."""
FIRST_FACETS = 512

CONVERGED, OUTSIDE, DEGENERATE = 0, 1, 2


@njit(cache=True)
def _initial_simplex(points: FloatArray, simplex: npt.NDArray[np.int64]) -> bool:
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
def _plane(
    points: FloatArray,
    vertices: npt.NDArray[np.int64],
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
    # Gram-Schmidt by Householder-free elimination: complete pivoting keeps thin facets accurate.
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
def _ridge_key(vertices: npt.NDArray[np.int64], leave_out: int) -> int:
    """Return one integer for a facet's ridge: the facet's sorted vertices without one of them."""
    key = 0
    for k in range(vertices.shape[0]):
        if k != leave_out:
            key = (key << INDEX_BITS) | vertices[k]
    return key


@njit(cache=True)
def _toggle(
    table: npt.NDArray[np.int64], owner: npt.NDArray[np.int64], key: int, facet: int, mask: int
) -> None:
    """Enter a ridge, or strike it out if it is there: ridges seen twice are inner ones."""
    slot = (key * 0x9E3779B1 >> 7) & mask
    while table[slot] != -1:
        if table[slot] == key:
            owner[slot] = -1 if owner[slot] >= 0 else facet
            return
        slot = (slot + 1) & mask
    table[slot] = key
    owner[slot] = facet


@njit(cache=True)
def _insert_sorted(
    vertices: npt.NDArray[np.int64], leave_out: int, point: int, out: npt.NDArray[np.int64]
) -> None:
    """Replace one vertex of a facet by a point and keep the indices sorted."""
    at = 0
    placed = False
    for k in range(vertices.shape[0]):
        if k == leave_out:
            continue
        if not placed and point < vertices[k]:
            out[at] = point
            at += 1
            placed = True
        out[at] = vertices[k]
        at += 1
    if not placed:
        out[at] = point


@njit(cache=True)
def _add_point(
    points: FloatArray,
    point: int,
    inside: FloatArray,
    vertices: npt.NDArray[np.int64],
    normals: FloatArray,
    offsets: FloatArray,
    areas: FloatArray,
    count: int,
    table: npt.NDArray[np.int64],
    owner: npt.NDArray[np.int64],
    work: FloatArray,
) -> int:
    """Replace all facets that see ``point`` by the cone from it to their horizon; return the new facet count.

    Facets are kept dense in the first ``count`` rows. Returns -1 if the arrays are too small and -2 if a new
    facet is degenerate.
    """
    d = points.shape[1]
    mask = table.shape[0] - 1
    table[:] = -1
    entered = 0
    kept = 0
    removed = np.empty(count, np.int64)
    n_removed = 0
    for f in range(count):
        height = -offsets[f]
        for k in range(d):
            height += normals[f, k] * points[point, k]
        if height > TOLERANCE:
            removed[n_removed] = f
            n_removed += 1
    entered = n_removed * d
    if entered * 2 > mask:
        return -1
    for r in range(n_removed):
        for k in range(d):
            _toggle(table, owner, _ridge_key(vertices[removed[r]], k), removed[r] * d + k, mask)
    new_vertices = np.empty((entered, d), np.int64)
    n_new = 0
    for slot in range(table.shape[0]):
        if table[slot] != -1 and owner[slot] >= 0:
            _insert_sorted(vertices[owner[slot] // d], owner[slot] % d, point, new_vertices[n_new])
            n_new += 1
    kept = count - n_removed
    if kept + n_new > offsets.shape[0]:
        return -1
    last = count - 1
    for r in range(n_removed - 1, -1, -1):
        f = removed[r]
        if f != last:
            vertices[f] = vertices[last]
            normals[f] = normals[last]
            offsets[f] = offsets[last]
            areas[f] = areas[last]
        last -= 1
    for i in range(n_new):
        f = kept + i
        vertices[f] = new_vertices[i]
        offsets[f], areas[f] = _plane(points, vertices[f], inside, work, normals[f])
        if areas[f] == 0.0:
            return -2
    return kept + n_new


@njit(cache=True)
def _start(
    points: FloatArray,
    simplex: npt.NDArray[np.int64],
    inside: FloatArray,
    vertices: npt.NDArray[np.int64],
    normals: FloatArray,
    offsets: FloatArray,
    areas: FloatArray,
    work: FloatArray,
) -> bool:
    """Write the d + 1 facets of the initial simplex; False if one is degenerate."""
    d = points.shape[1]
    ordered = np.sort(simplex)
    for f in range(d + 1):
        at = 0
        for k in range(d + 1):
            if k != f:
                vertices[f, at] = ordered[k]
                at += 1
        offsets[f], areas[f] = _plane(points, vertices[f], inside, work, normals[f])
        if areas[f] == 0.0:
            return False
    return True


@njit(cache=True)
def _nearest_facet(points: FloatArray, capacity: int) -> tuple[float, int]:
    """Return the origin's distance to the hull's nearest facet and how the search ended (-1: arrays too small)."""
    n, d = points.shape
    simplex = np.empty(d + 1, np.int64)
    if n < d + 1 or not _initial_simplex(points, simplex):
        return 0.0, OUTSIDE
    inside = np.zeros(d)
    for i in range(d + 1):
        inside += points[simplex[i]] / (d + 1)
    vertices = np.empty((capacity, d), np.int64)
    normals = np.empty((capacity, d))
    offsets = np.empty(capacity)
    areas = np.empty(capacity)
    work = np.empty((d - 1, d))
    table = np.empty(capacity * 8, np.int64)
    owner = np.empty(capacity * 8, np.int64)
    if not _start(points, simplex, inside, vertices, normals, offsets, areas, work):
        return 0.0, DEGENERATE
    count = d + 1
    for _ in range(4 * n + 16):
        nearest = 0
        for f in range(1, count):
            if offsets[f] < offsets[nearest]:
                nearest = f
        farthest, support = 0, -np.inf
        for i in range(n):
            height = 0.0
            for k in range(d):
                height += normals[nearest, k] * points[i, k]
            if height > support:
                farthest, support = i, height
        if support <= 0.0:
            return 0.0, OUTSIDE
        if support <= offsets[nearest] + TOLERANCE:
            return max(offsets[nearest], 0.0), CONVERGED
        count = _add_point(
            points, farthest, inside, vertices, normals, offsets, areas, count, table, owner, work
        )
        if count == -1:
            return 0.0, -1
        if count < 0:
            return 0.0, DEGENERATE
    return 0.0, DEGENERATE


@njit(cache=True)
def _volume(points: FloatArray, capacity: int) -> tuple[float, int]:
    """Return the hull's volume by adding one point after the other, and how it ended (-1: arrays too small)."""
    n, d = points.shape
    simplex = np.empty(d + 1, np.int64)
    if n < d + 1 or not _initial_simplex(points, simplex):
        return 0.0, CONVERGED
    inside = np.zeros(d)
    for i in range(d + 1):
        inside += points[simplex[i]] / (d + 1)
    vertices = np.empty((capacity, d), np.int64)
    normals = np.empty((capacity, d))
    offsets = np.empty(capacity)
    areas = np.empty(capacity)
    work = np.empty((d - 1, d))
    table = np.empty(capacity * 8, np.int64)
    owner = np.empty(capacity * 8, np.int64)
    if not _start(points, simplex, inside, vertices, normals, offsets, areas, work):
        return 0.0, DEGENERATE
    count = d + 1
    total = _cone_volume(points, simplex[0], inside, normals, offsets, areas, count, True)
    used = np.zeros(n, np.bool_)
    used[simplex] = True
    last = n - 1
    while last >= 0 and used[last]:
        last -= 1
    for i in range(n):
        if used[i]:
            continue
        total += _cone_volume(points, i, inside, normals, offsets, areas, count, False)
        if i == last:
            break
        count = _add_point(points, i, inside, vertices, normals, offsets, areas, count, table, owner, work)
        if count == -1:
            return 0.0, -1
        if count < 0:
            return 0.0, DEGENERATE
    return total, CONVERGED


@njit(cache=True)
def _cone_volume(
    points: FloatArray,
    point: int,
    inside: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    areas: FloatArray,
    count: int,
    whole: bool,
) -> float:
    """Return the volume between a point and the facets that see it, or of the whole polytope about ``inside``."""
    d = points.shape[1]
    factorial = 1.0
    for k in range(2, d + 1):
        factorial *= k
    total = 0.0
    for f in range(count):
        height = offsets[f] if whole else -offsets[f]
        for k in range(d):
            height += -normals[f, k] * inside[k] if whole else normals[f, k] * points[point, k]
        if height > 0.0:
            total += height * areas[f]
    return total / factorial


def origin_distance(points: FloatArray) -> float:
    """Return the radius of the largest origin-centred ball in the convex hull of points.

    Args:
        points: shape (n, d), d >= 2; n at most ``MOST_POINTS``.

    Returns:
        The radius; 0 when the origin lies outside or on the hull, or when the hull is flat.
    """
    contiguous = np.ascontiguousarray(points, dtype=np.float64)
    if len(contiguous) < MOST_POINTS:
        capacity = FIRST_FACETS
        while capacity <= FIRST_FACETS << 10:
            distance, end = _nearest_facet(contiguous, capacity)
            if end in (CONVERGED, OUTSIDE):
                return float(distance)
            if end == DEGENERATE:
                break
            capacity *= 4
    return _qhull_distance(contiguous)


def hull_volume(points: FloatArray) -> float:
    """Return the volume of the convex hull of points, shape (n, d); 0 when it is flat."""
    contiguous = np.ascontiguousarray(points, dtype=np.float64)
    if len(contiguous) < MOST_POINTS:
        capacity = FIRST_FACETS * 8
        while capacity <= FIRST_FACETS << 10:
            volume, end = _volume(contiguous, capacity)
            if end == CONVERGED:
                return float(volume)
            if end == DEGENERATE:
                break
            capacity *= 4
    hull = _qhull(contiguous)
    return 0.0 if hull is None else float(hull.volume)


def _qhull_distance(points: FloatArray) -> float:
    hull = _qhull(points)
    return 0.0 if hull is None else max(0.0, float((-hull.equations[:, -1]).min()))


def _qhull(points: FloatArray) -> ConvexHull | None:
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None
