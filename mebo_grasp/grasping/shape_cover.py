"""Spheres that cover a link's shape, with their centres inside it: cheap bounds on its distance to an object."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

from mebo_grasp.grasping.urdf import LinkShape

FloatArray = npt.NDArray[np.float64]

SPHERES_OF_ROD = 5
BOX_SPHERE_SPACING = 0.012
MOST_BOX_SPHERES_ALONG = 16
"""Longer boxes get larger spheres; in a hand they come from a wrong unit, and would fill the memory."""
SLICES_OF_MESH = 5
SHAPES_REMEMBERED = 256
"""A few hands; the largest allowed has 64 shapes."""


def covering_spheres(shape: LinkShape, T_group_shape: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return centres, shape (n, 3), in the group frame and radii (n,) of spheres whose union holds the shape."""
    centers, radii = _own_spheres(shape)
    return centers @ T_group_shape[:3, :3].T + T_group_shape[:3, 3], radii


@lru_cache(SHAPES_REMEMBERED)
def _own_spheres(shape: LinkShape) -> tuple[FloatArray, FloatArray]:
    """Return the same in the shape's own frame: a posture moves a shape, but its hull takes milliseconds."""
    if shape.kind == "sphere":
        centers, radii = np.zeros((1, 3)), np.array([shape.dims[0]])
    elif shape.kind == "capsule":
        centers, radii = _rod(shape.dims[1], shape.dims[0], shape.dims[1] / (SPHERES_OF_ROD - 1))
    elif shape.kind == "cylinder":
        piece = shape.dims[1] / SPHERES_OF_ROD
        centers, radii = _rod(shape.dims[1] - piece, shape.dims[0], piece)
    elif shape.kind == "box":
        centers, radii = _box_spheres(np.array(shape.dims))
    else:
        centers, radii = _mesh_spheres(np.asarray(shape.vertices))
    centers.flags.writeable = radii.flags.writeable = False
    return centers, radii


def _rod(span: float, radius: float, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Cover a rod about z with centres over ``span``; each sphere covers half a spacing to either side."""
    z = np.linspace(-span / 2.0, span / 2.0, SPHERES_OF_ROD)
    centers = np.column_stack([np.zeros_like(z), np.zeros_like(z), z])
    return centers, np.full(SPHERES_OF_ROD, np.hypot(radius, spacing / 2.0))


def _box_spheres(sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    counts = np.clip(np.ceil(sides / BOX_SPHERE_SPACING), 1, MOST_BOX_SPHERES_ALONG).astype(int)
    axes = [-sides[k] / 2.0 + sides[k] / counts[k] * (np.arange(counts[k]) + 0.5) for k in range(3)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return centers, np.full(len(centers), float(np.linalg.norm(sides / counts)) / 2.0)


def _mesh_spheres(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut a convex hull across its longest direction and take a sphere around each slice."""
    hull = trimesh.PointCloud(vertices).convex_hull
    _, _, directions = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    axis = directions[0]
    heights = vertices @ axis
    cuts = np.linspace(heights.min(), heights.max(), SLICES_OF_MESH + 1)
    centers, radii = [], []
    for low, high in pairwise(cuts):
        points = slab_points(hull, axis, low, high)
        if len(points) == 0:
            continue
        center = points.mean(axis=0)
        centers.append(center)
        radii.append(float(np.linalg.norm(points - center, axis=1).max()))
    return np.array(centers), np.array(radii)


def slab_points(mesh: trimesh.Trimesh, axis: FloatArray, low: float, high: float) -> FloatArray:
    """Return the corners of the part of a surface whose height along an axis lies between two values, shape (n, 3).

    These are the vertices in between, and the points where edges cross the two planes.
    """
    vertices, edges = np.asarray(mesh.vertices), np.asarray(mesh.edges_unique)
    heights = vertices @ axis
    found = [vertices[(heights >= low) & (heights <= high)]]
    start, end = heights[edges[:, 0]], heights[edges[:, 1]]
    for cut in (low, high):
        crosses = (start - cut) * (end - cut) < 0.0
        share = ((cut - start[crosses]) / (end[crosses] - start[crosses]))[:, None]
        first, second = vertices[edges[crosses, 0]], vertices[edges[crosses, 1]]
        found.append(first + share * (second - first))
    return np.vstack(found)
