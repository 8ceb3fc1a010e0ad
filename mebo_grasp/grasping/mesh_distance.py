"""Distances from segments and boxes to the triangles of an object, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.triangle_tree import Node, Triangle, TriangleTree, closest_on_triangle

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
def _height(p: FloatArray, triangle: Triangle) -> float:
    """Return the height of a point over a triangle's plane."""
    return (
        triangle.normal[0] * (p[0] - triangle.corners[0, 0])
        + triangle.normal[1] * (p[1] - triangle.corners[0, 1])
        + triangle.normal[2] * (p[2] - triangle.corners[0, 2])
    )


@njit(cache=True)
def _over(x: float, y: float, z: float, triangle: Triangle) -> bool:
    """Whether a point lies over the inside of a triangle, seen along its normal; never if it has none."""
    before = 2
    for k in range(3):
        e0 = triangle.corners[k, 0] - triangle.corners[before, 0]
        e1 = triangle.corners[k, 1] - triangle.corners[before, 1]
        e2 = triangle.corners[k, 2] - triangle.corners[before, 2]
        w0, w1, w2 = x - triangle.corners[k, 0], y - triangle.corners[k, 1], z - triangle.corners[k, 2]
        turn = (
            triangle.normal[0] * (e1 * w2 - e2 * w1)
            + triangle.normal[1] * (e2 * w0 - e0 * w2)
            + triangle.normal[2] * (e0 * w1 - e1 * w0)
        )
        if turn <= 0.0:
            return False
        before = k
    return True


@njit(cache=True)
def _segment_edge2(p: FloatArray, q: FloatArray, triangle: Triangle, k: int) -> float:
    """Return the squared distance between the segment pq and the edge of a triangle that begins at corner k."""
    following = (k + 1) % 3
    # Scalars: a view of a row costs more here than its numbers.
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    c = triangle.corners
    r0, r1, r2 = c[k, 0], c[k, 1], c[k, 2]
    e0, e1, e2 = c[following, 0] - r0, c[following, 1] - r1, c[following, 2] - r2
    w0, w1, w2 = p[0] - r0, p[1] - r1, p[2] - r2
    t, u = _places(
        d0 * d0 + d1 * d1 + d2 * d2,
        e0 * e0 + e1 * e1 + e2 * e2,
        d0 * e0 + d1 * e1 + d2 * e2,
        d0 * w0 + d1 * w1 + d2 * w2,
        e0 * w0 + e1 * w1 + e2 * w2,
    )
    return (w0 + t * d0 - u * e0) ** 2 + (w1 + t * d1 - u * e1) ** 2 + (w2 + t * d2 - u * e2) ** 2


@njit(cache=True)
def _segment_triangle(p: FloatArray, q: FloatArray, triangle: Triangle, bound: float) -> float:
    """Return the distance between a segment and a triangle, ``bound`` if it is no less; 0 where they cross.

    The nearest place is an end over the triangle's inside, or on an edge; no place is nearer than the plane.
    """
    first, last = _height(p, triangle), _height(q, triangle)
    same_side = first * last > 0.0
    least = min(abs(first), abs(last))
    if same_side and least >= bound:
        return bound
    if not same_side and first != last:
        t = first / (first - last)
        x, y, z = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2])
        if _over(x, y, z, triangle):
            return 0.0
    best = bound
    if abs(first) < best and _over(p[0], p[1], p[2], triangle):
        best = abs(first)
    if abs(last) < best and _over(q[0], q[1], q[2], triangle):
        best = abs(last)
    if same_side and best <= least:
        return best
    best2 = best * best
    for k in range(3):
        distance2 = _segment_edge2(p, q, triangle, k)
        if distance2 < best2:
            best, best2 = np.sqrt(distance2), distance2
    return best


@njit(cache=True)
def _ball_gap(p: FloatArray, q: FloatArray, held: Node | Triangle) -> float:
    """Return the gap between the segment pq and the ball of a node or triangle; negative if they meet."""
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    w0, w1, w2 = held.ball[0] - p[0], held.ball[1] - p[1], held.ball[2] - p[2]
    length2 = d0 * d0 + d1 * d1 + d2 * d2
    t = min(max((w0 * d0 + w1 * d1 + w2 * d2) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return np.sqrt((t * d0 - w0) ** 2 + (t * d1 - w1) ** 2 + (t * d2 - w2) ** 2) - held.ball[3]


@njit(cache=True)
def _box_gap2(p: FloatArray, q: FloatArray, node: Node) -> float:
    """Return the squared gap between a node's box and the box of the segment pq."""
    total = 0.0
    for k in range(3):
        apart = max(node.lower[k] - max(p[k], q[k]), min(p[k], q[k]) - node.upper[k], 0.0)
        total += apart * apart
    return total


@njit(cache=True)
def _nearest_pair(p: FloatArray, q: FloatArray, triangle: Triangle, out: FloatArray) -> None:
    """Write the nearest points of the segment pq and of a triangle, which it does not cross, shape (2, 3)."""
    best, on_triangle = np.inf, np.empty(3)
    for end in (p, q):
        closest_on_triangle(end, triangle.corners, on_triangle)
        distance2 = 0.0
        for k in range(3):
            distance2 += (end[k] - on_triangle[k]) ** 2
        if distance2 < best:
            best = distance2
            for k in range(3):
                out[0, k], out[1, k] = end[k], on_triangle[k]
    for edge in range(3):
        r, s = triangle.corners[edge], triangle.corners[(edge + 1) % 3]
        t, u = _segment_segment_places(p, q, r, s)
        distance2 = 0.0
        for k in range(3):
            distance2 += (p[k] + t * (q[k] - p[k]) - r[k] - u * (s[k] - r[k])) ** 2
        if distance2 < best:
            best = distance2
            for k in range(3):
                out[0, k], out[1, k] = p[k] + t * (q[k] - p[k]), r[k] + u * (s[k] - r[k])


@njit(cache=True)
def _look_back(p: FloatArray, q: FloatArray, triangle: Triangle, distance: float, u: FloatArray) -> float:
    """Write the unit direction from a triangle to the segment where they are nearest; return the segment's height."""
    pair, first, last = np.empty((2, 3)), 0.0, 0.0
    _nearest_pair(p, q, triangle, pair)
    for k in range(3):
        u[k] = (pair[0, k] - pair[1, k]) / distance
        first += u[k] * p[k]
        last += u[k] * q[k]
    return min(first, last)


@njit(cache=True)
def _behind(triangle: Triangle, u: FloatArray, height: float) -> bool:
    """Whether a triangle reaches no higher than ``height`` along a direction."""
    for corner in range(3):
        c = triangle.corners[corner]
        along = u[0] * c[0] + u[1] * c[1] + u[2] * c[2]
        if along > height:
            return False
    return True


@njit(cache=True)
def _box_behind(node: Node, u: FloatArray, height: float) -> bool:
    """Whether a node's box reaches no higher than ``height`` along a direction."""
    along = 0.0
    for k in range(3):
        along += max(u[k] * node.lower[k], u[k] * node.upper[k])
    return along <= height


@njit(cache=True)
def _nearest_triangle(  # noqa: C901
    tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float, likely: int = -1
) -> tuple[float, int]:
    """Return the distance between a segment and the surface and the triangle; ``bound`` and -1 if not below it.

    A triangle that is ``likely`` the nearest is looked at first: its distance rejects what is farther off, and the
    direction to it what lies behind it, on a convex surface all the rest.
    """
    triangles, nodes = tree.triangles, tree.nodes
    best, found, u = bound, -1, np.empty(3)
    directed, level = False, 0.0
    if likely >= 0:
        best = _segment_triangle(p, q, triangles[likely], bound)
        found = likely if best < bound else -1
        if 0.0 < best < bound:
            directed, level = True, _look_back(p, q, triangles[likely], best, u) + NEGLIGIBLE
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    stack[0], gaps[0] = 0, _ball_gap(p, q, nodes[0])
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        at = stack[top]
        node = nodes[at]
        if gaps[top] >= best or (directed and _box_behind(node, u, level - best)):
            continue
        if _box_gap2(p, q, node) >= best * best:
            continue
        if node.right == 0:
            for i in range(node.start, node.end):
                if i == likely or _ball_gap(p, q, triangles[i]) >= best:
                    continue
                if directed and _behind(triangles[i], u, level - best):
                    continue
                distance = _segment_triangle(p, q, triangles[i], best)
                if distance < best:
                    best, found = distance, i
            continue
        near, far = at + 1, node.right
        near_gap, far_gap = _ball_gap(p, q, nodes[near]), _ball_gap(p, q, nodes[far])
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
        _nearest_pair(p, q, tree.triangles[i], out)
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
        at = stack[top]
        node = tree.nodes[at]
        apart2 = 0.0
        for k in range(3):
            gap = max(node.lower[k] - middle[k] - reach[k], middle[k] - reach[k] - node.upper[k], 0.0)
            apart2 += gap * gap
        if apart2 >= best * best:
            continue
        if node.right != 0:
            stack[top] = node.right
            stack[top + 1] = at + 1
            top += 2
            continue
        for i in range(node.start, node.end):
            for corner in range(3):
                local[corner] = R.T @ (tree.triangles[i].corners[corner] - middle)
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
