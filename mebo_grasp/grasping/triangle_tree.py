"""A tree of bounding volumes over an object's triangles, and the nearest surface point to a point.

A node has a box and a ball: the box fits flat parts, the ball rejects what a slanting rod's own box would not.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.borrowed import borrowed

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAF_SIZE = 4


TRIANGLE_TYPE = np.dtype(
    [("corners", np.float64, (3, 3)), ("normal", np.float64, (3,)), ("ball", np.float64, (4,))], align=True
)
"""A triangle: its corners, its unit normal (0 without area), centre and radius of a ball about it."""

NODE_TYPE = np.dtype(
    [
        ("lower", np.float64, (3,)),
        ("upper", np.float64, (3,)),
        ("ball", np.float64, (4,)),
        ("right", np.int64),
        ("start", np.int64),
        ("end", np.int64),
    ],
    align=True,
)
"""A node of the tree.

lower, upper: its box
ball: centre and radius of a ball about its triangles
right: its second child; 0 marks a leaf (the first child follows its parent)
start, end: range of a leaf's triangles
"""

Triangle: TypeAlias = Any
"""A record of ``TRIANGLE_TYPE``."""
Node: TypeAlias = Any
"""A record of ``NODE_TYPE``."""


class TriangleTree(NamedTuple):
    """Bounding boxes and balls over triangles, in depth-first order.

    Attributes:
        triangles: (n,) of ``TRIANGLE_TYPE``, sorted by leaf.
        nodes: (m,) of ``NODE_TYPE``.
    """

    triangles: npt.NDArray[np.void]
    nodes: npt.NDArray[np.void]


@njit(cache=True)
def borrowed_tree(tree: TriangleTree) -> TriangleTree:
    """Return a tree whose arrays are ``borrowed``."""
    return TriangleTree(borrowed(tree.triangles), borrowed(tree.nodes))


def build_tree(triangles: FloatArray) -> TriangleTree:
    """Sort triangles, shape (n, 3, 3), into a tree of bounding boxes."""
    centroids = triangles.mean(axis=1)
    order = np.arange(len(triangles))
    nodes: list[tuple[int, int]] = []
    rights: list[int] = []
    stack = [(0, len(triangles), -1)]
    while stack:
        start, end, parent = stack.pop()
        index = len(nodes)
        if parent >= 0:
            rights[parent] = index
        leaf = end - start <= LEAF_SIZE
        nodes.append((start, end))
        rights.append(0)
        if not leaf:
            axis = int(np.ptp(centroids[order[start:end]], axis=0).argmax())
            middle = (start + end) // 2
            part = np.argpartition(centroids[order[start:end], axis], middle - start)
            order[start:end] = order[start:end][part]
            stack.append((middle, end, index))
            stack.append((start, middle, -1))
    ordered = np.ascontiguousarray(triangles[order])
    sorted_triangles, sorted_nodes = np.zeros(len(ordered), TRIANGLE_TYPE), np.zeros(len(nodes), NODE_TYPE)
    sorted_triangles["corners"], sorted_triangles["normal"] = ordered, _normals(ordered)
    sorted_nodes["right"] = rights
    sorted_nodes["start"], sorted_nodes["end"] = np.array(nodes).T
    _enclose(sorted_triangles, sorted_nodes)
    return TriangleTree(sorted_triangles, sorted_nodes)


@njit(cache=True)
def _enclose(triangles: npt.NDArray[np.void], nodes: npt.NDArray[np.void]) -> None:
    """Write the balls of triangles, and boxes and balls of nodes."""
    lower, upper = np.empty(3), np.empty(3)
    for i in range(len(triangles)):
        _enclose_corners(triangles, i, i + 1, lower, upper, triangles[i].ball)
    for node in nodes:
        _enclose_corners(triangles, node.start, node.end, node.lower, node.upper, node.ball)


@njit(cache=True)
def _enclose_corners(
    triangles: npt.NDArray[np.void], start: int, end: int, lower: FloatArray, upper: FloatArray, ball: FloatArray
) -> None:
    """Write box and ball of a range of triangles; the ball is about the middle of the box."""
    lower[:], upper[:] = np.inf, -np.inf
    for i in range(start, end):
        for corner in triangles[i].corners:
            for k in range(3):
                lower[k], upper[k] = min(lower[k], corner[k]), max(upper[k], corner[k])
    farthest = 0.0
    for k in range(3):
        ball[k] = 0.5 * (lower[k] + upper[k])
    for i in range(start, end):
        for corner in triangles[i].corners:
            away = 0.0
            for k in range(3):
                away += (corner[k] - ball[k]) ** 2
            farthest = max(farthest, away)
    ball[3] = np.sqrt(farthest)


def _normals(triangles: FloatArray) -> FloatArray:
    """Return the unit normals of triangles, shape (n, 3); 0 for a triangle without area."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice_area = np.linalg.norm(across, axis=1, keepdims=True)
    return np.ascontiguousarray(np.divide(across, twice_area, out=np.zeros_like(across), where=twice_area > 0.0))


@njit(cache=True)
def closest_on_triangle(p: FloatArray, triangle: FloatArray, out: FloatArray) -> None:
    """Write the point of a triangle nearest to p (Ericson, Real-Time Collision Detection, 2005, section 5.1.5)."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for k in range(3):
        ab, ac = b[k] - a[k], c[k] - a[k]
        d1 += ab * (p[k] - a[k])
        d2 += ac * (p[k] - a[k])
        d3 += ab * (p[k] - b[k])
        d4 += ac * (p[k] - b[k])
        d5 += ab * (p[k] - c[k])
        d6 += ac * (p[k] - c[k])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
    for k in range(3):
        out[k] = a[k] + v * (b[k] - a[k]) + w * (c[k] - a[k])


@njit(cache=True)
def _box_distance2(p: FloatArray, node: Node) -> float:
    total = 0.0
    for k in range(3):
        gap = max(node.lower[k] - p[k], 0.0, p[k] - node.upper[k])
        total += gap * gap
    return total


@njit(cache=True)
def closest_point(tree: TriangleTree, p: FloatArray, bound: float, out: FloatArray) -> tuple[float, int]:
    """Write the surface point nearest to p and return its distance and triangle; -1 if none within ``bound``."""
    best, found = bound * bound, -1
    candidate = np.empty(3)
    stack = np.empty(64, np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        at = stack[top]
        node = tree.nodes[at]
        if _box_distance2(p, node) >= best:
            continue
        if node.right == 0:
            for i in range(node.start, node.end):
                closest_on_triangle(p, tree.triangles[i].corners, candidate)
                distance2 = 0.0
                for k in range(3):
                    distance2 += (candidate[k] - p[k]) ** 2
                if distance2 < best:
                    best, found = distance2, i
                    for k in range(3):
                        out[k] = candidate[k]
            continue
        near, far = at + 1, node.right
        if _box_distance2(p, tree.nodes[far]) < _box_distance2(p, tree.nodes[near]):
            near, far = far, near
        stack[top] = far
        stack[top + 1] = near
        top += 2
    return np.sqrt(best), found
