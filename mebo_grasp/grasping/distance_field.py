"""A grid of signed distances to an object's surface.

Its value is within ``slack`` of the true signed distance, so that it proves most links free or colliding without
an exact query.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import trimesh
from numba import njit
from scipy import ndimage

from mebo_grasp.grasping.borrowed import borrowed
from mebo_grasp.grasping.triangle_tree import TriangleTree, closest_point

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_CELLS_ALONG = 96
SMALLEST_CELL = 0.0012
MARGIN_CELLS = 3
MOST_HEIGHTS = 500_000
"""Pairs of a line and a plane that are looked at together: all at once would take a gigabyte for a fine mesh."""
VERTICAL = 1e-12
"""A plane whose unit normal rises by less is taken for vertical."""


class DistanceField(NamedTuple):
    """Signed distances at the nodes of a regular grid, negative inside.

    Attributes:
        values: (nx, ny, nz) metres.
        origin: x, y, z of node (0, 0, 0), object frame, metres.
        cell: side of a cell, metres.
        slack: bound on the difference between the interpolated value and the true distance, metres.
        margin: distance that the object keeps from the faces of the grid, metres.
    """

    values: FloatArray
    origin: tuple[float, float, float]
    cell: float
    slack: float
    margin: float


@njit(cache=True)
def borrowed_field(field: DistanceField) -> DistanceField:
    """Return a field whose arrays are ``borrowed``."""
    return DistanceField(borrowed(field.values), field.origin, field.cell, field.slack, field.margin)


@njit(cache=True)
def _grid_distances(tree: TriangleTree, origin: FloatArray, cell: float, values: FloatArray, nearest: IntArray) -> None:
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


def inside_parts(axes: list[FloatArray], parts: tuple[FloatArray, ...]) -> npt.NDArray[np.bool_]:
    """Return which nodes of a grid lie in one of the convex parts.

    A line along z meets a convex part in one interval, so that all planes are asked once a line and not once a node.

    Args:
        axes: x, y and z of the nodes, shapes (nx,), (ny,), (nz,).
        parts: each (n, 3) vertices.

    Returns:
        Shape (nx, ny, nz).
    """
    lines = np.stack(np.meshgrid(axes[0], axes[1], indexing="ij"), axis=-1).reshape(-1, 2)
    inside = np.zeros((len(lines), len(axes[2])), dtype=bool)
    for part in parts:
        hull = trimesh.PointCloud(part).convex_hull
        normals, corners = np.asarray(hull.face_normals), np.asarray(hull.triangles[:, 0])
        offsets = np.einsum("ij,ij->i", normals, corners)
        low, high = part[:, :2].min(axis=0), part[:, :2].max(axis=0)
        near = np.flatnonzero(np.all((lines >= low) & (lines <= high), axis=1))
        for some in np.array_split(near, 1 + len(near) * len(normals) // MOST_HEIGHTS):
            inside[some] |= _behind_planes(lines[some], axes[2], normals, offsets)
    return inside.reshape(len(axes[0]), len(axes[1]), len(axes[2]))


def _behind_planes(lines: FloatArray, z: FloatArray, normals: FloatArray, offsets: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which points of lines along z, shape (lines, len(z)), lie behind all planes: normal . p <= offset."""
    left = offsets - lines @ normals[:, :2].T
    slope = normals[:, 2]
    rising, falling = slope > VERTICAL, slope < -VERTICAL
    top = (left[:, rising] / slope[rising]).min(axis=1, initial=np.inf)
    bottom = (left[:, falling] / slope[falling]).max(axis=1, initial=-np.inf)
    beside = np.all(left[:, ~(rising | falling)] >= 0.0, axis=1)
    return beside[:, None] & (z >= bottom[:, None]) & (z <= top[:, None])


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
    corners = tree.triangles["corners"][nearest[skin]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    behind = np.einsum("ij,ij->i", normals, points.reshape(*labels.shape, 3)[skin] - corners.mean(axis=1)) < 0.0
    inside = ~outside & ~skin
    enclosed = ndimage.binary_dilation(inside, iterations=2)[skin]
    inside[skin] = behind & enclosed
    return inside


def build_field(bounds: FloatArray, tree: TriangleTree, parts: tuple[FloatArray, ...] = ()) -> DistanceField:
    """Compute the signed distances of a surface on a grid around it.

    Args:
        bounds: corners of the surface's box, shape (2, 3), metres.
        tree: its triangles.
        parts: convex parts that make up the solid, which then say what is inside.
    """
    lower, upper = bounds
    cell = max(float((upper - lower).max()) / MOST_CELLS_ALONG, SMALLEST_CELL)
    counts = np.ceil((upper - lower) / cell).astype(int) + 1 + 2 * MARGIN_CELLS
    origin = (lower + upper) / 2.0 - (counts - 1) * cell / 2.0
    margin = float(np.min(lower - origin))
    values = np.empty(tuple(counts))
    nearest = np.empty(tuple(counts), dtype=np.int64)
    _grid_distances(tree, origin, cell, values, nearest)
    axes = [origin[k] + cell * np.arange(counts[k]) for k in range(3)]
    if parts:
        inside = inside_parts(axes, parts)
    else:
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = _inside_surface(values, nearest, points, tree, cell)
    values[inside] *= -1.0
    # Interpolation weighs the eight corners of a cell; their mean distance from a point is at most that from
    # the cell's centre, and distances differ by no more than the points do.
    x, y, z = origin.tolist()
    return DistanceField(values, (x, y, z), cell, cell * np.sqrt(3.0) / 2.0, margin)


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
