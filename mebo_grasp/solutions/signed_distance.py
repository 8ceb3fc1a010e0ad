"""Distances from points to occluding shapes, negative inside, compiled.

All of them are exact, and change by no more than the point moves. Everything that decides whether a grasp
is blocked rests on them. A ``Scene`` is s occlusions as arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.bounding_tree import LEAF, BoundingTree
from mebo_grasp.solutions.diversity import IntArray

BOX, SPHERE, CYLINDER, CONE, MESH = range(5)
STACK_SIZE = 64
"""Deeper than any balanced tree over fewer than 2^62 triangles needs."""

# A direction that no edge of a man-made mesh runs along, so that a ray meets faces and not edges.
_RAY = (0.5377, 0.2213, 0.8135)

Triple = tuple[float, float, float]


class Scene(NamedTuple):
    """s occlusions in the object's frame.

    Args:
        kinds: ``BOX`` to ``MESH``, shape (s,).
        sizes: half edges of a box; radius of a sphere; half height and radius of a cylinder or cone;
            1 for a closed mesh; shape (s, 3).
        rotations: of the shape's frame in the object's, shape (s, 3, 3).
        origins: of the shape's frame in the object's, shape (s, 3), metres.
        margins: by which a shape is thickened, shape (s,), metres.
        meshes: where the mesh's triangles begin in ``triangles``, and its root among the nodes, shape (s, 2).
        triangles: corners of all triangles, in the order of the trees, shape (f, 3, 3).
        tree: the trees of all meshes, one behind another; ``order`` is not used.
    """

    kinds: IntArray
    sizes: FloatArray
    rotations: FloatArray
    origins: FloatArray
    margins: FloatArray
    meshes: IntArray
    triangles: FloatArray
    tree: BoundingTree


@njit(cache=True, nogil=True)
def _box(half: FloatArray, x: float, y: float, z: float) -> float:
    dx, dy, dz = abs(x) - half[0], abs(y) - half[1], abs(z) - half[2]
    ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return math.sqrt(ox * ox + oy * oy + oz * oz) + min(float(max(dx, max(dy, dz))), 0.0)


@njit(cache=True, nogil=True)
def _cylinder(half_height: float, radius: float, x: float, y: float, z: float) -> float:
    dr, dz = math.sqrt(x * x + y * y) - radius, abs(z) - half_height
    outside_r, outside_z = max(dr, 0.0), max(dz, 0.0)
    return math.sqrt(outside_r * outside_r + outside_z * outside_z) + min(max(dr, dz), 0.0)


@njit(cache=True, nogil=True)
def _cone(half_height: float, radius: float, x: float, y: float, z: float) -> float:
    # In the half-plane of distance r from the axis the cone is a triangle; its edge on the axis is inside.
    r, h = math.sqrt(x * x + y * y), 2.0 * half_height
    over_edge = max(r - radius, 0.0)
    to_base = math.sqrt(over_edge * over_edge + (z + half_height) ** 2)
    along = ((radius - r) * radius + (z + half_height) * h) / (radius * radius + h * h)
    along = min(max(along, 0.0), 1.0)
    side_r, side_z = r - radius * (1.0 - along), z + half_height - h * along
    distance = min(to_base, math.sqrt(side_r * side_r + side_z * side_z))
    is_inside = z >= -half_height and r <= radius * (0.5 - z / h)
    return -distance if is_inside else distance


@njit(cache=True, nogil=True)
def _minus(a: Triple, b: Triple) -> Triple:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, nogil=True)
def _dot(a: Triple, b: Triple) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True, nogil=True)
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def _corner(triangles: FloatArray, face: int, corner: int) -> Triple:
    return triangles[face, corner, 0], triangles[face, corner, 1], triangles[face, corner, 2]


@njit(cache=True, nogil=True)
def _squared_to_segment(p: Triple, a: Triple, b: Triple) -> float:
    ab, ap = _minus(b, a), _minus(p, a)
    length = _dot(ab, ab)
    t = min(max(_dot(ap, ab) / length, 0.0), 1.0) if length > 0.0 else 0.0
    rest = ap[0] - t * ab[0], ap[1] - t * ab[1], ap[2] - t * ab[2]
    return float(_dot(rest, rest))


@njit(cache=True, nogil=True)
def _squared_to_triangle(p: Triple, triangles: FloatArray, face: int) -> float:
    a, b, c = _corner(triangles, face, 0), _corner(triangles, face, 1), _corner(triangles, face, 2)
    ab, ac, ap = _minus(b, a), _minus(c, a), _minus(p, a)
    normal = _cross(ab, ac)
    area = _dot(normal, normal)
    if area > 0.0:
        v, w = _dot(_cross(ap, ac), normal), _dot(_cross(ab, ap), normal)
        if v >= 0.0 and w >= 0.0 and v + w <= area:
            height = _dot(ap, normal)
            return float(height * height / area)
    to_edges = min(
        _squared_to_segment(p, a, b), _squared_to_segment(p, b, c), _squared_to_segment(p, c, a)
    )
    return float(to_edges)


@njit(cache=True, nogil=True)
def _squared_to_node(p: Triple, low: FloatArray, high: FloatArray) -> float:
    total = 0.0
    for axis in range(3):
        outside = max(max(low[axis] - p[axis], p[axis] - high[axis]), 0.0)
        total += outside * outside
    return total


@njit(cache=True, nogil=True)
def _mesh_surface(scene: Scene, shape: int, p: Triple) -> float:
    """Return the distance to the nearest triangle."""
    tree, first = scene.tree, scene.meshes[shape, 0]
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = scene.meshes[shape, 1]
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if _squared_to_node(p, tree.low[node], tree.high[node]) >= best:
            continue
        if tree.left[node] == LEAF:
            for k in range(tree.begin[node], tree.end[node]):
                best = min(best, _squared_to_triangle(p, scene.triangles, first + k))
            continue
        near, far = tree.left[node], tree.left[node] + 1
        if _squared_to_node(p, tree.low[far], tree.high[far]) < _squared_to_node(
            p, tree.low[near], tree.high[near]
        ):
            near, far = far, near
        stack[depth], stack[depth + 1] = far, near
        depth += 2
    return math.sqrt(best)


@njit(cache=True, nogil=True)
def _ray_meets_node(p: Triple, low: FloatArray, high: FloatArray) -> bool:
    enter, leave = 0.0, np.inf
    for axis in range(3):
        enter = max(enter, (low[axis] - p[axis]) / _RAY[axis])
        leave = min(leave, (high[axis] - p[axis]) / _RAY[axis])
    return enter <= leave


@njit(cache=True, nogil=True)
def _ray_meets_triangle(p: Triple, triangles: FloatArray, face: int) -> bool:
    corner = _corner(triangles, face, 0)
    edge_1 = _minus(_corner(triangles, face, 1), corner)
    edge_2 = _minus(_corner(triangles, face, 2), corner)
    across = _cross(_RAY, edge_2)
    determinant = _dot(edge_1, across)
    if determinant == 0.0:
        return False
    offset = _minus(p, corner)
    turned = _cross(offset, edge_1)
    u, v = _dot(offset, across) / determinant, _dot(_RAY, turned) / determinant
    return bool(u >= 0.0 and v >= 0.0 and u + v <= 1.0 and _dot(edge_2, turned) / determinant > 0.0)


@njit(cache=True, nogil=True)
def _is_inside_mesh(scene: Scene, shape: int, p: Triple) -> bool:
    """Tell by the number of faces that a ray from the point passes."""
    tree, first = scene.tree, scene.meshes[shape, 0]
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = scene.meshes[shape, 1]
    depth, passed = 1, 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if not _ray_meets_node(p, tree.low[node], tree.high[node]):
            continue
        if tree.left[node] == LEAF:
            for k in range(tree.begin[node], tree.end[node]):
                passed += _ray_meets_triangle(p, scene.triangles, first + k)
            continue
        stack[depth], stack[depth + 1] = tree.left[node], tree.left[node] + 1
        depth += 2
    return passed % 2 == 1


@njit(cache=True, nogil=True)
def distance_in_shape_frame(scene: Scene, shape: int, x: float, y: float, z: float) -> float:
    """Return the signed distance from a point of the shape's frame, the margin not yet taken off, metres."""
    kind, size = scene.kinds[shape], scene.sizes[shape]
    if kind == BOX:
        return float(_box(size, x, y, z))
    if kind == SPHERE:
        return float(math.sqrt(x * x + y * y + z * z) - size[0])
    if kind == CYLINDER:
        return float(_cylinder(size[0], size[1], x, y, z))
    if kind == CONE:
        return float(_cone(size[0], size[1], x, y, z))
    p = (x, y, z)
    distance = float(_mesh_surface(scene, shape, p))
    if size[0] > 0.0 and _is_inside_mesh(scene, shape, p):
        return -distance
    return distance


@njit(cache=True, nogil=True)
def distance_to(scene: Scene, shape: int, x: float, y: float, z: float) -> float:
    """Return the signed distance from a point of the object's frame to a thickened occlusion, metres."""
    R, origin = scene.rotations[shape], scene.origins[shape]
    dx, dy, dz = x - origin[0], y - origin[1], z - origin[2]
    local_x = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz
    local_y = R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    local_z = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz
    distance = distance_in_shape_frame(scene, shape, local_x, local_y, local_z)
    return float(distance - scene.margins[shape])


@njit(cache=True, nogil=True)
def distances_to(scene: Scene, shape: int, points: FloatArray) -> npt.NDArray[np.float64]:
    """Return the signed distances from points of the object's frame, shape (n, 3), to one occlusion."""
    distances = np.empty(len(points))
    for i in range(len(points)):
        distances[i] = distance_to(scene, shape, points[i, 0], points[i, 1], points[i, 2])
    return distances
