"""Distances from segments and boxes to the triangles of an object, compiled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.triangle_tree import TriangleTree, closest_on_triangle

FloatArray = npt.NDArray[np.float64]


@njit(cache=True)
def _segment_segment_places(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> tuple[float, float]:
    """Return where segments pq and rs are nearest, as shares of their lengths (Ericson, 2005, section 5.1.9)."""
    a = e = b = c = f = 0.0
    for k in range(3):
        d1, d2, w = q[k] - p[k], s[k] - r[k], p[k] - r[k]
        a += d1 * d1
        e += d2 * d2
        b += d1 * d2
        c += d1 * w
        f += d2 * w
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
def segment_segment(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> float:
    """Return the distance between segments pq and rs."""
    t, u = _segment_segment_places(p, q, r, s)
    total = 0.0
    for k in range(3):
        total += (p[k] + t * (q[k] - p[k]) - r[k] - u * (s[k] - r[k])) ** 2
    return np.sqrt(total)


@njit(cache=True)
def _crosses(p: FloatArray, q: FloatArray, triangle: FloatArray) -> bool:
    """Whether the segment pq passes through a triangle (Moeller and Trumbore, 1997)."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    # Scalars, since a small array for each difference would cost more than all the rest.
    e10, e11, e12 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    e20, e21, e22 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    w0, w1, w2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    h0, h1, h2 = d1 * e22 - d2 * e21, d2 * e20 - d0 * e22, d0 * e21 - d1 * e20
    det = e10 * h0 + e11 * h1 + e12 * h2
    if abs(det) < 1e-20:
        return False
    u = (w0 * h0 + w1 * h1 + w2 * h2) / det
    if u < 0.0 or u > 1.0:
        return False
    g0, g1, g2 = w1 * e12 - w2 * e11, w2 * e10 - w0 * e12, w0 * e11 - w1 * e10
    v = (d0 * g0 + d1 * g1 + d2 * g2) / det
    t = (e20 * g0 + e21 * g1 + e22 * g2) / det
    return v >= 0.0 and u + v <= 1.0 and 0.0 <= t <= 1.0


@njit(cache=True)
def _segment_triangle(p: FloatArray, q: FloatArray, triangle: FloatArray, scratch: FloatArray) -> float:
    """Return the distance between a segment and a triangle: at an end, at an edge, or 0 where they cross."""
    if _crosses(p, q, triangle):
        return 0.0
    best = np.inf
    for end in (p, q):
        closest_on_triangle(end, triangle, scratch)
        total = 0.0
        for k in range(3):
            total += (scratch[k] - end[k]) ** 2
        best = min(best, total)
    best = np.sqrt(best)
    for k in range(3):
        best = min(best, segment_segment(p, q, triangle[k], triangle[(k + 1) % 3]))
    return best


@njit(cache=True)
def _boxes_gap2(tree: TriangleTree, node: int, middle: FloatArray, half: FloatArray) -> float:
    """Return the squared gap between a node's box and a box given by its middle and half sides."""
    total = 0.0
    for k in range(3):
        low, high = tree.lower[node, k], tree.upper[node, k]
        apart = max(low - middle[k] - half[k], middle[k] - half[k] - high, 0.0)
        total += apart * apart
    return total


@njit(cache=True)
def _ball_gap(p: FloatArray, q: FloatArray, ball: FloatArray) -> float:
    """Return the gap between the segment pq and a ball, its centre and radius in one row; negative if they meet."""
    along = length2 = 0.0
    for k in range(3):
        d = q[k] - p[k]
        along += (ball[k] - p[k]) * d
        length2 += d * d
    t = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    total = 0.0
    for k in range(3):
        total += (p[k] + t * (q[k] - p[k]) - ball[k]) ** 2
    return np.sqrt(total) - ball[3]


@njit(cache=True)
def _nearest_triangle(tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float) -> tuple[float, int]:
    """Return the distance between a segment and the surface and the triangle; ``bound`` and -1 if not below it."""
    best, found = bound, -1
    scratch, stack = np.empty(3), np.empty(64, np.int64)
    middle, half = 0.5 * (p + q), 0.5 * np.abs(q - p)
    stack[0] = 0
    top = 1
    while top > 0 and best > 0.0:
        top -= 1
        node = stack[top]
        if _ball_gap(p, q, tree.ball[node]) >= best or _boxes_gap2(tree, node, middle, half) >= best * best:
            continue
        if tree.right[node] == 0:
            for i in range(tree.start[node], tree.end[node]):
                if _ball_gap(p, q, tree.triangle_ball[i]) < best:
                    distance = _segment_triangle(p, q, tree.triangles[i], scratch)
                    if distance < best:
                        best, found = distance, i
            continue
        near, far = node + 1, tree.right[node]
        if _ball_gap(p, q, tree.ball[far]) < _ball_gap(p, q, tree.ball[near]):
            near, far = far, near
        stack[top] = far
        stack[top + 1] = near
        top += 2
    return best, found


@njit(cache=True)
def segment_distance(tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float) -> float:
    """Return the distance between a segment and the surface, at most ``bound``; 0 where they cross."""
    return _nearest_triangle(tree, p, q, bound)[0]


@njit(cache=True)
def nearest_points(tree: TriangleTree, p: FloatArray, q: FloatArray, bound: float, out: FloatArray) -> float:
    """Write the nearest points of a segment and of the surface into ``out``, shape (2, 3); return their distance.

    Returns ``bound`` and writes nothing if they are no nearer; the segment must not cross the surface.
    """
    distance, i = _nearest_triangle(tree, p, q, bound)
    if i < 0:
        return distance
    triangle, best, on_surface = tree.triangles[i], np.inf, np.empty(3)
    for end in (p, q):
        closest_on_triangle(end, triangle, on_surface)
        best = _take_nearer(end, on_surface, best, out)
    for k in range(3):
        first, second = triangle[k], triangle[(k + 1) % 3]
        t, u = _segment_segment_places(p, q, first, second)
        best = _take_nearer(p + t * (q - p), first + u * (second - first), best, out)
    return best


@njit(cache=True)
def _take_nearer(a: FloatArray, b: FloatArray, best: float, out: FloatArray) -> float:
    distance = np.sqrt(np.sum((a - b) ** 2))
    if distance < best:
        out[0] = a
        out[1] = b
        return distance
    return best


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
