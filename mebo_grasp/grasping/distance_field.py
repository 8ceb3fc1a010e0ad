"""Distances from points to an object's surface: a tree of triangles, and a grid of signed distances.

The grid serves the trials: its value is within ``slack`` of the true signed distance, so that it proves most
links free or colliding without an exact query.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import trimesh
from numba import njit
from scipy import ndimage

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAF_SIZE = 4
MOST_CELLS_ALONG = 96
SMALLEST_CELL = 0.0012
MARGIN_CELLS = 3


class TriangleTree(NamedTuple):
    """Bounding boxes over triangles, in depth-first order.

    Attributes:
        triangles: (n, 3, 3) corners, sorted by leaf.
        lower, upper: (m, 3) boxes of the nodes.
        right: (m,) index of a node's second child; 0 marks a leaf (the first child follows its parent).
        start, end: (m,) range of a leaf's triangles.
        order: (n,) index of each sorted triangle in the mesh.
    """

    triangles: FloatArray
    lower: FloatArray
    upper: FloatArray
    right: IntArray
    start: IntArray
    end: IntArray
    order: IntArray


class DistanceField(NamedTuple):
    """Signed distances at the nodes of a regular grid, negative inside.

    Attributes:
        values: (nx, ny, nz) metres.
        origin: (3,) position of node (0, 0, 0), object frame.
        cell: side of a cell, metres.
        slack: bound on the difference between the interpolated value and the true distance, metres.
        margin: distance that the object keeps from the faces of the grid, metres.
    """

    values: FloatArray
    origin: FloatArray
    cell: float
    slack: float
    margin: float


def build_tree(triangles: FloatArray) -> TriangleTree:
    """Sort triangles, shape (n, 3, 3), into a tree of bounding boxes."""
    centroids = triangles.mean(axis=1)
    order = np.arange(len(triangles))
    nodes: list[tuple[int, int, int]] = []
    rights: list[int] = []
    stack = [(0, len(triangles), -1)]
    while stack:
        start, end, parent = stack.pop()
        index = len(nodes)
        if parent >= 0:
            rights[parent] = index
        leaf = end - start <= LEAF_SIZE
        nodes.append((start, end, 1 if leaf else 0))
        rights.append(0)
        if not leaf:
            axis = int(np.ptp(centroids[order[start:end]], axis=0).argmax())
            middle = (start + end) // 2
            part = np.argpartition(centroids[order[start:end], axis], middle - start)
            order[start:end] = order[start:end][part]
            stack.append((middle, end, index))
            stack.append((start, middle, -1))
    starts, ends, _ = np.array(nodes).T
    ordered = np.ascontiguousarray(triangles[order])
    lower = np.array([ordered[s:e].min(axis=(0, 1)) for s, e in zip(starts, ends, strict=True)])
    upper = np.array([ordered[s:e].max(axis=(0, 1)) for s, e in zip(starts, ends, strict=True)])
    return TriangleTree(
        ordered,
        lower,
        upper,
        np.array(rights),
        np.ascontiguousarray(starts),
        np.ascontiguousarray(ends),
        order,
    )


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
def _box_distance2(p: FloatArray, lower: FloatArray, upper: FloatArray) -> float:
    total = 0.0
    for k in range(3):
        gap = max(lower[k] - p[k], 0.0, p[k] - upper[k])
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
        node = stack[top]
        if _box_distance2(p, tree.lower[node], tree.upper[node]) >= best:
            continue
        if tree.right[node] == 0:
            for i in range(tree.start[node], tree.end[node]):
                closest_on_triangle(p, tree.triangles[i], candidate)
                distance2 = 0.0
                for k in range(3):
                    distance2 += (candidate[k] - p[k]) ** 2
                if distance2 < best:
                    best, found = distance2, i
                    for k in range(3):
                        out[k] = candidate[k]
            continue
        near, far = node + 1, tree.right[node]
        if _box_distance2(p, tree.lower[far], tree.upper[far]) < _box_distance2(
            p, tree.lower[near], tree.upper[near]
        ):
            near, far = far, near
        stack[top] = far
        stack[top + 1] = near
        top += 2
    return np.sqrt(best), found


@njit(cache=True)
def _grid_distances(
    tree: TriangleTree, origin: FloatArray, cell: float, values: FloatArray, nearest: IntArray
) -> None:
    nx, ny, nz = values.shape
    p, out = np.empty(3), np.empty(3)
    for i in range(nx):
        for j in range(ny):
            before = np.inf
            for k in range(nz):
                p[0], p[1], p[2] = origin[0] + i * cell, origin[1] + j * cell, origin[2] + k * cell
                # Distance changes by at most one cell from node to node, which bounds the search.
                bound = before + cell * 1.001 + 1e-12 if before < np.inf else 1e9
                before, nearest[i, j, k] = closest_point(tree, p, bound, out)
                values[i, j, k] = before


def inside_parts(points: FloatArray, parts: tuple[FloatArray, ...]) -> npt.NDArray[np.bool_]:
    """Return which points, shape (n, 3), lie in one of the convex parts."""
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        hull = trimesh.PointCloud(part).convex_hull
        normals, corners = np.asarray(hull.face_normals), np.asarray(hull.triangles[:, 0])
        near = np.all((points >= part.min(axis=0)) & (points <= part.max(axis=0)), axis=1) & ~inside
        heights = points[near] @ normals.T - np.einsum("ij,ij->i", normals, corners)
        inside[near] = np.all(heights <= 0.0, axis=1)
    return inside


def _inside_surface(
    distances: FloatArray, nearest: IntArray, points: FloatArray, tree: TriangleTree, cell: float
) -> npt.NDArray[np.bool_]:
    """Tell inside from outside by what a closed skin of nodes near the surface encloses.

    Nodes of the skin itself are inside where they lie behind their nearest triangle.
    """
    skin = distances <= 0.9 * cell
    labels, _ = ndimage.label(~skin)
    border = np.ones(labels.shape, dtype=bool)
    border[1:-1, 1:-1, 1:-1] = False
    outside = np.isin(labels, np.unique(labels[border]))
    corners = tree.triangles[nearest[skin]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    behind = (
        np.einsum("ij,ij->i", normals, points.reshape(*labels.shape, 3)[skin] - corners.mean(axis=1)) < 0.0
    )
    inside = ~outside & ~skin
    enclosed = ndimage.binary_dilation(inside, iterations=2)[skin]
    inside[skin] = behind & enclosed
    return inside


def build_field(surface: trimesh.Trimesh, parts: tuple[FloatArray, ...] = ()) -> DistanceField:
    """Compute the signed distances of a surface on a grid around it.

    Args:
        surface: triangles, metres.
        parts: convex parts that make up the solid, which then say what is inside.
    """
    lower, upper = np.array(surface.bounds)
    cell = max(float((upper - lower).max()) / MOST_CELLS_ALONG, SMALLEST_CELL)
    counts = np.ceil((upper - lower) / cell).astype(int) + 1 + 2 * MARGIN_CELLS
    origin = (lower + upper) / 2.0 - (counts - 1) * cell / 2.0
    margin = float(np.min(lower - origin))
    tree = build_tree(np.array(surface.triangles, dtype=np.float64))
    values = np.empty(tuple(counts))
    nearest = np.empty(tuple(counts), dtype=np.int64)
    _grid_distances(tree, origin, cell, values, nearest)
    axes = [origin[k] + cell * np.arange(counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if parts:
        inside = inside_parts(points, parts).reshape(values.shape)
    else:
        inside = _inside_surface(values, nearest, points, tree, cell)
    values[inside] *= -1.0
    # Interpolation weighs the eight corners of a cell; their mean distance from a point is at most that from
    # the cell's centre, and distances differ by no more than the points do.
    return DistanceField(values, origin, cell, cell * np.sqrt(3.0) / 2.0, margin)


@njit(cache=True)
def on_grid(field: DistanceField, x: float, y: float, z: float) -> bool:
    """Whether a point lies within the grid, where ``sample`` is near the distance and not only a bound of it."""
    for k, value in enumerate((x, y, z)):
        at = (value - field.origin[k]) / field.cell
        if at < 0.0 or at > field.values.shape[k] - 1.0:
            return False
    return True


@njit(cache=True)
def sample(field: DistanceField, x: float, y: float, z: float) -> float:
    """Return the interpolated signed distance; outside the grid a lower bound of it."""
    nx, ny, nz = field.values.shape
    u = (x - field.origin[0]) / field.cell
    v = (y - field.origin[1]) / field.cell
    w = (z - field.origin[2]) / field.cell
    cu = min(max(u, 0.0), nx - 1.0)
    cv = min(max(v, 0.0), ny - 1.0)
    cw = min(max(w, 0.0), nz - 1.0)
    if cu != u or cv != v or cw != w:
        away = np.sqrt((u - cu) ** 2 + (v - cv) ** 2 + (w - cw) ** 2) * field.cell
        return away + field.margin + field.slack
    i, j, k = min(int(cu), nx - 2), min(int(cv), ny - 2), min(int(cw), nz - 2)
    a, b, c = cu - i, cv - j, cw - k
    g = field.values
    low = (1 - a) * ((1 - b) * g[i, j, k] + b * g[i, j + 1, k]) + a * (
        (1 - b) * g[i + 1, j, k] + b * g[i + 1, j + 1, k]
    )
    high = (1 - a) * ((1 - b) * g[i, j, k + 1] + b * g[i, j + 1, k + 1]) + a * (
        (1 - b) * g[i + 1, j, k + 1] + b * g[i + 1, j + 1, k + 1]
    )
    return (1 - c) * low + c * high
