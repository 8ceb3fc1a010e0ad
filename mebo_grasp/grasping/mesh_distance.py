"""Distances from segments and boxes to the triangles of an object, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.triangle_tree import TriangleTree, closest_on_triangle

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NEGLIGIBLE = 1e-10
"""A triangle that could be nearer by no more than this is not looked at, metres."""


@njit(cache=True)
def _places(a: float, e: float, b: float, c: float, f: float) -> tuple[float, float]:
    """Return where two segments are nearest, as shares of their lengths (Ericson, 2005, section 5.1.9).

    Args:
        a: squared length of the first segment.
        e: that of the second.
        b: product of their directions.
        c: product of the first direction and the way from the second's beginning to the first's.
        f: the same of the second direction.
    """
    if a <= 1e-18:
        t = 0.0
        u = min(max(f / e, 0.0), 1.0) if e > 1e-18 else 0.0
    elif e <= 1e-18:
        u = 0.0
        t = min(max(-c / a, 0.0), 1.0)
    else:
        denominator = a * e - b * b
        t = min(max((b * f - c * e) / denominator, 0.0), 1.0) if denominator > 1e-18 else 0.0
        u = (b * t + f) / e
        if u < 0.0:
            u = 0.0
            t = min(max(-c / a, 0.0), 1.0)
        elif u > 1.0:
            u = 1.0
            t = min(max((b - c) / a, 0.0), 1.0)
    return t, u


@njit(cache=True)
def _segment_segment_places(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> tuple[float, float]:
    """Return where segments pq and rs are nearest, as shares of their lengths."""
    a = e = b = c = f = 0.0
    for k in range(3):
        d1, d2, w = q[k] - p[k], s[k] - r[k], p[k] - r[k]
        a += d1 * d1
        e += d2 * d2
        b += d1 * d2
        c += d1 * w
        f += d2 * w
    return _places(a, e, b, c, f)


@njit(cache=True)
def segment_segment(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> float:
    """Return the distance between segments pq and rs."""
    t, u = _segment_segment_places(p, q, r, s)
    total = 0.0
    for k in range(3):
        total += (p[k] + t * (q[k] - p[k]) - r[k] - u * (s[k] - r[k])) ** 2
    return np.sqrt(total)


@njit(cache=True)
def _height(p: FloatArray, triangles: FloatArray, normals: FloatArray, i: int) -> float:
    """Return the height of a point over the plane of triangle i."""
    return (
        normals[i, 0] * (p[0] - triangles[i, 0, 0])
        + normals[i, 1] * (p[1] - triangles[i, 0, 1])
        + normals[i, 2] * (p[2] - triangles[i, 0, 2])
    )


@njit(cache=True)
def _over(x: float, y: float, z: float, triangles: FloatArray, normals: FloatArray, i: int) -> bool:
    """Whether a point lies over the inside of triangle i, seen along its normal; never if it has none."""
    before = 2
    for k in range(3):
        e0 = triangles[i, k, 0] - triangles[i, before, 0]
        e1 = triangles[i, k, 1] - triangles[i, before, 1]
        e2 = triangles[i, k, 2] - triangles[i, before, 2]
        w0, w1, w2 = x - triangles[i, k, 0], y - triangles[i, k, 1], z - triangles[i, k, 2]
        turn = (
            normals[i, 0] * (e1 * w2 - e2 * w1)
            + normals[i, 1] * (e2 * w0 - e0 * w2)
            + normals[i, 2] * (e0 * w1 - e1 * w0)
        )
        if turn <= 0.0:
            return False
        before = k
    return True


@njit(cache=True)
def _segment_edge2(p: FloatArray, q: FloatArray, triangles: FloatArray, i: int, k: int) -> float:
    """Return the squared distance between the segment pq and the edge of triangle i that begins at corner k."""
    following = (k + 1) % 3
    # Scalars: a view of a row costs more here than its numbers.
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    r0, r1, r2 = triangles[i, k, 0], triangles[i, k, 1], triangles[i, k, 2]
    e0, e1, e2 = triangles[i, following, 0] - r0, triangles[i, following, 1] - r1, triangles[i, following, 2] - r2
    w0, w1, w2 = p[0] - r0, p[1] - r1, p[2] - r2
    t, u = _places(
        d0 * d0 + d1 * d1 + d2 * d2, e0 * e0 + e1 * e1 + e2 * e2, d0 * e0 + d1 * e1 + d2 * e2,
        d0 * w0 + d1 * w1 + d2 * w2, e0 * w0 + e1 * w1 + e2 * w2,
    )
    return (w0 + t * d0 - u * e0) ** 2 + (w1 + t * d1 - u * e1) ** 2 + (w2 + t * d2 - u * e2) ** 2


@njit(cache=True)
def _segment_triangle(
    p: FloatArray, q: FloatArray, triangles: FloatArray, normals: FloatArray, i: int, bound: float
) -> float:
    """Return the distance between a segment and triangle i, ``bound`` if it is no less; 0 where they cross.

    The nearest place is an end over the triangle's inside, or on an edge; no place is nearer than the plane.
    """
    first, last = _height(p, triangles, normals, i), _height(q, triangles, normals, i)
    same_side = first * last > 0.0
    least = min(abs(first), abs(last))
    if same_side and least >= bound:
        return bound
    if not same_side and first != last:
        t = first / (first - last)
        x, y, z = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2])
        if _over(x, y, z, triangles, normals, i):
            return 0.0
    best = bound
    if abs(first) < best and _over(p[0], p[1], p[2], triangles, normals, i):
        best = abs(first)
    if abs(last) < best and _over(q[0], q[1], q[2], triangles, normals, i):
        best = abs(last)
    if same_side and best <= least:
        return best
    best2 = best * best
    for k in range(3):
        distance2 = _segment_edge2(p, q, triangles, i, k)
        if distance2 < best2:
            best, best2 = np.sqrt(distance2), distance2
    return best


@njit(cache=True)
def _ball_gap(p: FloatArray, q: FloatArray, balls: FloatArray, i: int) -> float:
    """Return the gap between the segment pq and ball i, centre and radius in a row; negative if they meet."""
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    w0, w1, w2 = balls[i, 0] - p[0], balls[i, 1] - p[1], balls[i, 2] - p[2]
    length2 = d0 * d0 + d1 * d1 + d2 * d2
    t = min(max((w0 * d0 + w1 * d1 + w2 * d2) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return np.sqrt((t * d0 - w0) ** 2 + (t * d1 - w1) ** 2 + (t * d2 - w2) ** 2) - balls[i, 3]


@njit(cache=True)
def _box_gap2(p: FloatArray, q: FloatArray, lower: FloatArray, upper: FloatArray, i: int) -> float:
    """Return the squared gap between box i and the box of the segment pq."""
    total = 0.0
    for k in range(3):
        apart = max(lower[i, k] - max(p[k], q[k]), min(p[k], q[k]) - upper[i, k], 0.0)
        total += apart * apart
    return total


@njit(cache=True)
def _nearest_pair(p: FloatArray, q: FloatArray, triangles: FloatArray, i: int, out: FloatArray) -> None:
    """Write the nearest points of the segment pq and of triangle i, which it does not cross, shape (2, 3)."""
    best, on_triangle = np.inf, np.empty(3)
    for end in (p, q):
        closest_on_triangle(end, triangles[i], on_triangle)
        distance2 = 0.0
        for k in range(3):
            distance2 += (end[k] - on_triangle[k]) ** 2
        if distance2 < best:
            best = distance2
            for k in range(3):
                out[0, k], out[1, k] = end[k], on_triangle[k]
    for edge in range(3):
        r, s = triangles[i, edge], triangles[i, (edge + 1) % 3]
        t, u = _segment_segment_places(p, q, r, s)
        distance2 = 0.0
        for k in range(3):
            distance2 += (p[k] + t * (q[k] - p[k]) - r[k] - u * (s[k] - r[k])) ** 2
        if distance2 < best:
            best = distance2
            for k in range(3):
                out[0, k], out[1, k] = p[k] + t * (q[k] - p[k]), r[k] + u * (s[k] - r[k])


@njit(cache=True)
def _look_back(
    p: FloatArray, q: FloatArray, triangles: FloatArray, i: int, distance: float, u: FloatArray
) -> float:
    """Write the unit direction from triangle i to the segment where they are nearest; return the segment's height."""
    pair, first, last = np.empty((2, 3)), 0.0, 0.0
    _nearest_pair(p, q, triangles, i, pair)
    for k in range(3):
        u[k] = (pair[0, k] - pair[1, k]) / distance
        first += u[k] * p[k]
        last += u[k] * q[k]
    return min(first, last)


@njit(cache=True)
def _behind(triangles: FloatArray, i: int, u: FloatArray, height: float) -> bool:
    """Whether triangle i reaches no higher than ``height`` along a direction."""
    for corner in range(3):
        along = u[0] * triangles[i, corner, 0] + u[1] * triangles[i, corner, 1] + u[2] * triangles[i, corner, 2]
        if along > height:
            return False
    return True


@njit(cache=True)
def _box_behind(lower: FloatArray, upper: FloatArray, i: int, u: FloatArray, height: float) -> bool:
    """Whether box i reaches no higher than ``height`` along a direction."""
    along = 0.0
    for k in range(3):
        along += max(u[k] * lower[i, k], u[k] * upper[i, k])
    return along <= height


@njit(cache=True)
def _nearest_triangle(  # noqa: C901
    tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float, likely: int = -1
) -> tuple[float, int]:
    """Return the distance between a segment and the surface and the triangle; ``bound`` and -1 if not below it.

    A triangle that is ``likely`` the nearest is looked at first: its distance rejects what is farther off, and the
    direction to it what lies behind it, on a convex surface all the rest.
    """
    triangles, normals, triangle_balls, balls = tree.triangles, tree.normals, tree.triangle_ball, tree.ball
    lower, upper, right = tree.lower, tree.upper, tree.right
    best, found, u = bound, -1, np.empty(3)
    directed, level = False, 0.0
    if likely >= 0:
        best = _segment_triangle(p, q, triangles, normals, likely, bound)
        found = likely if best < bound else -1
        if 0.0 < best < bound:
            directed, level = True, _look_back(p, q, triangles, likely, best, u) + NEGLIGIBLE
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    stack[0], gaps[0] = 0, _ball_gap(p, q, balls, 0)
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        node = stack[top]
        if gaps[top] >= best or (directed and _box_behind(lower, upper, node, u, level - best)):
            continue
        if _box_gap2(p, q, lower, upper, node) >= best * best:
            continue
        if right[node] == 0:
            for i in range(tree.start[node], tree.end[node]):
                if i == likely or _ball_gap(p, q, triangle_balls, i) >= best:
                    continue
                if directed and _behind(triangles, i, u, level - best):
                    continue
                distance = _segment_triangle(p, q, triangles, normals, i, best)
                if distance < best:
                    best, found = distance, i
            continue
        near, far = node + 1, right[node]
        near_gap, far_gap = _ball_gap(p, q, balls, near), _ball_gap(p, q, balls, far)
        if far_gap < near_gap:
            near, far, near_gap, far_gap = far, near, far_gap, near_gap
        stack[top], gaps[top] = far, far_gap
        stack[top + 1], gaps[top + 1] = near, near_gap
        top += 2
    return best, found


@njit(cache=True)
def segment_distance(tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float) -> float:
    """Return the distance between a segment and the surface, at most ``bound``; 0 where they cross."""
    return _nearest_triangle(tree, p, q, bound)[0]


@njit(cache=True)
def tracked_distance(
    tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float, nearest: IntArray, which: int
) -> float:
    """The same for a segment that moves little from call to call; its nearest triangle is kept in ``nearest[which]``.

    A triangle of -1 is not known yet. The distance is the same to ``NEGLIGIBLE`` whatever stands there.
    """
    distance, found = _nearest_triangle(tree, p, q, bound, nearest[which])
    if found >= 0:
        nearest[which] = found
    return distance


@njit(cache=True)
def nearest_points(
    tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float, out: FloatArray, likely: int = -1
) -> float:
    """Write the nearest points of a segment and of the surface into ``out``, shape (2, 3); return their distance.

    Returns ``bound`` and writes nothing if they are no nearer; the segment must not cross the surface. ``likely`` is
    the triangle that is expected to be the nearest, -1 for none.
    """
    distance, i = _nearest_triangle(tree, p, q, bound, likely)
    if i >= 0:
        _nearest_pair(p, q, tree.triangles, i, out)
    return distance


@njit(cache=True)
def _axis_separates(a: FloatArray, b: FloatArray, c: FloatArray, axis: FloatArray, half: FloatArray) -> bool:
    """Whether a triangle and a box about the origin have a gap along an axis."""
    x = axis[0] * a[0] + axis[1] * a[1] + axis[2] * a[2]
    y = axis[0] * b[0] + axis[1] * b[1] + axis[2] * b[2]
    z = axis[0] * c[0] + axis[1] * c[1] + axis[2] * c[2]
    r = half[0] * abs(axis[0]) + half[1] * abs(axis[1]) + half[2] * abs(axis[2])
    return min(x, y, z) > r or max(x, y, z) < -r


@njit(cache=True)
def _box_meets_triangle(local: FloatArray, half: FloatArray) -> bool:
    """Whether a triangle, corners in rows in the frame of a box about the origin, meets it (Akenine-Moeller, 2001)."""
    a, b, c = local[0], local[1], local[2]
    axis = np.zeros(3)
    for k in range(3):
        axis[:] = 0.0
        axis[k] = 1.0
        if _axis_separates(a, b, c, axis, half):
            return False
    if _axis_separates(a, b, c, np.cross(b - a, c - a), half):
        return False
    for i in range(3):
        edge = local[(i + 1) % 3] - local[i]
        for k in range(3):
            axis[:] = 0.0
            axis[(k + 1) % 3] = -edge[(k + 2) % 3]
            axis[(k + 2) % 3] = edge[(k + 1) % 3]
            if _axis_separates(a, b, c, axis, half):
                return False
    return True


@njit(cache=True)
def box_gap(tree: TriangleTree, pose: FloatArray, box: FloatArray, center: FloatArray, bound: float) -> float:
    """Return -bound if a box meets the surface, else a bound on their gap from below, at most ``bound``.

    Args:
        tree: the surface.
        pose: (4, 4) of the box's group.
        box: (4, 3) axes as rows in the group's frame, then half sides.
        center: (3,) in the group's frame.
        bound: distance beyond which nothing matters, metres.
    """
    R = pose[:3, :3].copy() @ box[:3].T.copy()
    middle = pose[:3, :3].copy() @ center + pose[:3, 3]
    half = box[3]
    reach = np.abs(R) @ half
    local = np.empty((3, 3))
    stack = np.empty(64, np.int64)
    stack[0] = 0
    top, best = 1, bound
    while top > 0:
        top -= 1
        node = stack[top]
        apart2 = 0.0
        for k in range(3):
            gap = max(
                tree.lower[node, k] - middle[k] - reach[k], middle[k] - reach[k] - tree.upper[node, k], 0.0
            )
            apart2 += gap * gap
        if apart2 >= best * best:
            continue
        if tree.right[node] != 0:
            stack[top] = tree.right[node]
            stack[top + 1] = node + 1
            top += 2
            continue
        for i in range(tree.start[node], tree.end[node]):
            for corner in range(3):
                local[corner] = R.T @ (tree.triangles[i, corner] - middle)
            if _box_meets_triangle(local, half):
                return -bound
            best = min(best, _box_bound(local, half))
    return best


@njit(cache=True)
def _box_bound(local: FloatArray, half: FloatArray) -> float:
    """Return the distance between a box about the origin and a triangle's bounding box, at least a small gap."""
    apart2 = 0.0
    for k in range(3):
        low, high = min(local[0, k], local[1, k], local[2, k]), max(local[0, k], local[1, k], local[2, k])
        gap = max(low - half[k], -half[k] - high, 0.0)
        apart2 += gap * gap
    return max(np.sqrt(apart2), 1e-6)
