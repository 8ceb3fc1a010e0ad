"""Distances from points to occluding shapes, negative inside, compiled.

All of them are exact, and change by no more than the point moves. Everything that decides whether a grasp
is blocked rests on them. A ``Scene`` is s occlusions as arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mebo_grasp.compiling import borrowing, borrowing_inlined, compiled
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.bounding_tree import LEAF, BoundingTree

BOX, SPHERE, CYLINDER, CONE, MESH = range(5)
STACK_SIZE = 64
"""Deeper than any balanced tree over fewer than 2^62 triangles needs."""

# A direction that no edge of a man-made mesh runs along, so that a ray meets faces and not edges.
_RAY = (0.5377, 0.2213, 0.8135)

Triple = tuple[float, float, float]


class Scene(NamedTuple):
    """s occlusions in the object's frame.

    Args:
        shapes: for each occlusion its kind (``BOX`` to ``MESH``); three sizes (half edges of a box; radius of
            a sphere; half height and radius of a cylinder or cone; 1 for a closed mesh); the nine
            elements of its rotation, row by row, and its origin in the object's frame; the margin by
            which it is thickened; the radius about its origin outside of which nothing of it is; for a mesh,
            where its triangles begin in ``triangles`` and where its root is among the nodes; shape
            (s, ``COLUMNS``).
        triangles: corners of all triangles, in the order of the trees, shape (f, 3, 3).
        tree: the trees of all meshes, one behind another; ``order`` is not used.
    """

    shapes: FloatArray
    triangles: FloatArray
    tree: BoundingTree


# What the columns of Scene.shapes hold.
_SIZE, _ROTATION, _ORIGIN, _MARGIN, _REACH, _FIRST_TRIANGLE, _ROOT = 1, 4, 13, 16, 17, 18, 19
COLUMNS = 20


@compiled
def rotation_matrix(q: FloatArray) -> FloatArray:
    """Return the matrix of a unit quaternion xyzw, shape (3, 3)."""
    R = np.empty((3, 3))
    write_rotation(q, R)
    return R


@borrowing
def write_rotation(q: FloatArray, R: FloatArray) -> None:
    """Write the matrix of a unit quaternion xyzw into ``R``, shape (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@borrowing
def _box(half_x: float, half_y: float, half_z: float, x: float, y: float, z: float) -> float:
    dx, dy, dz = abs(x) - half_x, abs(y) - half_y, abs(z) - half_z
    ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return math.sqrt(ox * ox + oy * oy + oz * oz) + min(max(dx, max(dy, dz)), 0.0)


@borrowing
def _cylinder(half_height: float, radius: float, x: float, y: float, z: float) -> float:
    dr, dz = math.sqrt(x * x + y * y) - radius, abs(z) - half_height
    outside_r, outside_z = max(dr, 0.0), max(dz, 0.0)
    return math.sqrt(outside_r * outside_r + outside_z * outside_z) + min(max(dr, dz), 0.0)


@borrowing
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


@borrowing
def _minus(a: Triple, b: Triple) -> Triple:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@borrowing
def _dot(a: Triple, b: Triple) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@borrowing
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@borrowing
def _corner(triangles: FloatArray, face: int, corner: int) -> Triple:
    return triangles[face, corner, 0], triangles[face, corner, 1], triangles[face, corner, 2]


@borrowing
def _squared_to_segment(p: Triple, a: Triple, b: Triple) -> float:
    ab, ap = _minus(b, a), _minus(p, a)
    length = _dot(ab, ab)
    t = min(max(_dot(ap, ab) / length, 0.0), 1.0) if length > 0.0 else 0.0
    rest = ap[0] - t * ab[0], ap[1] - t * ab[1], ap[2] - t * ab[2]
    return float(_dot(rest, rest))


@borrowing
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
    to_edges = min(_squared_to_segment(p, a, b), _squared_to_segment(p, b, c), _squared_to_segment(p, c, a))
    return float(to_edges)


@borrowing
def _squared_to_node(p: Triple, low: FloatArray, high: FloatArray, node: int) -> float:
    total = 0.0
    for axis in range(3):
        outside = max(max(low[node, axis] - p[axis], p[axis] - high[node, axis]), 0.0)
        total += outside * outside
    return total


@compiled
def _mesh_surface(scene: Scene, shape: int, p: Triple) -> float:
    """Return the distance to the nearest triangle."""
    tree, first = scene.tree, int(scene.shapes[shape, _FIRST_TRIANGLE])
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = int(scene.shapes[shape, _ROOT])
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if _squared_to_node(p, tree.low, tree.high, node) >= best:
            continue
        if tree.left[node] == LEAF:
            for k in range(tree.begin[node], tree.end[node]):
                best = min(best, _squared_to_triangle(p, scene.triangles, first + k))
            continue
        near, far = tree.left[node], tree.left[node] + 1
        to_near = _squared_to_node(p, tree.low, tree.high, near)
        if _squared_to_node(p, tree.low, tree.high, far) < to_near:
            near, far = far, near
        stack[depth], stack[depth + 1] = far, near
        depth += 2
    return math.sqrt(best)


@borrowing
def _ray_meets_node(p: Triple, low: FloatArray, high: FloatArray, node: int) -> bool:
    enter, leave = 0.0, np.inf
    for axis in range(3):
        enter = max(enter, (low[node, axis] - p[axis]) / _RAY[axis])
        leave = min(leave, (high[node, axis] - p[axis]) / _RAY[axis])
    return enter <= leave


@borrowing
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


@compiled
def _is_inside_mesh(scene: Scene, shape: int, p: Triple) -> bool:
    """Tell by the number of faces that a ray from the point passes."""
    tree, first = scene.tree, int(scene.shapes[shape, _FIRST_TRIANGLE])
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = int(scene.shapes[shape, _ROOT])
    depth, passed = 1, 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if not _ray_meets_node(p, tree.low, tree.high, node):
            continue
        if tree.left[node] == LEAF:
            for k in range(tree.begin[node], tree.end[node]):
                passed += _ray_meets_triangle(p, scene.triangles, first + k)
            continue
        stack[depth], stack[depth + 1] = tree.left[node], tree.left[node] + 1
        depth += 2
    return passed % 2 == 1


@borrowing
def _mesh(scene: Scene, shape: int, x: float, y: float, z: float) -> float:
    p = _to_shape_frame(scene.shapes, shape, x, y, z)
    distance = float(_mesh_surface(scene, shape, p))
    if scene.shapes[shape, _SIZE] > 0.0 and _is_inside_mesh(scene, shape, p):
        distance = -distance
    return distance


@borrowing
def _to_shape_frame(shapes: FloatArray, shape: int, x: float, y: float, z: float) -> Triple:
    dx = x - shapes[shape, _ORIGIN]
    dy = y - shapes[shape, _ORIGIN + 1]
    dz = z - shapes[shape, _ORIGIN + 2]
    k = _ROTATION
    return (
        shapes[shape, k] * dx + shapes[shape, k + 3] * dy + shapes[shape, k + 6] * dz,
        shapes[shape, k + 1] * dx + shapes[shape, k + 4] * dy + shapes[shape, k + 7] * dz,
        shapes[shape, k + 2] * dx + shapes[shape, k + 5] * dy + shapes[shape, k + 8] * dz,
    )


@borrowing
def _primitive(shapes: FloatArray, shape: int, x: float, y: float, z: float) -> float:
    x, y, z = _to_shape_frame(shapes, shape, x, y, z)
    kind, size = shapes[shape, 0], shapes[shape, _SIZE]
    if kind == BOX:
        return float(_box(size, shapes[shape, _SIZE + 1], shapes[shape, _SIZE + 2], x, y, z))
    if kind == SPHERE:
        return float(math.sqrt(x * x + y * y + z * z) - size)
    if kind == CYLINDER:
        return float(_cylinder(size, shapes[shape, _SIZE + 1], x, y, z))
    return float(_cone(size, shapes[shape, _SIZE + 1], x, y, z))


@borrowing
def primitive_distance(shapes: FloatArray, shape: int, x: float, y: float, z: float) -> float:
    """Return the signed distance from a point of the object's frame to a thickened primitive, metres."""
    return float(_primitive(shapes, shape, x, y, z) - shapes[shape, _MARGIN])


@borrowing
def mesh_distance(scene: Scene, shape: int, x: float, y: float, z: float) -> float:
    """Return the signed distance from a point of the object's frame to a thickened mesh, metres."""
    return float(_mesh(scene, shape, x, y, z) - scene.shapes[shape, _MARGIN])


@borrowing_inlined
def is_beyond(shapes: FloatArray, shape: int, x: float, y: float, z: float, radius: float) -> bool:
    """Tell quickly that a ball about a point is clear of an occlusion; False where it may meet it.

    Args:
        shapes: of a ``Scene``.
        shape: index of the occlusion.
        x: of the point, metres.
        y: of the point, metres.
        z: of the point, metres.
        radius: of the ball, metres.
    """
    reach = shapes[shape, _REACH] + radius
    dx = x - shapes[shape, _ORIGIN]
    dy = y - shapes[shape, _ORIGIN + 1]
    dz = z - shapes[shape, _ORIGIN + 2]
    return reach < 0.0 or dx * dx + dy * dy + dz * dz > reach * reach


# Inlined by numba itself, with the array of shapes beside the scene that holds it: to take the array out of
# the scene, or to hand a scene to a function, takes longer than a distance.
@borrowing_inlined
def distance_to(shapes: FloatArray, scene: Scene, shape: int, x: float, y: float, z: float) -> float:
    """Return the signed distance from a point of the object's frame to a thickened occlusion, metres.

    Args:
        shapes: ``scene.shapes``.
        scene: occlusions.
        shape: index of the occlusion.
        x: of the point, metres.
        y: of the point, metres.
        z: of the point, metres.
    """
    if shapes[shape, 0] == MESH:
        distance = mesh_distance(scene, shape, x, y, z)
    else:
        distance = primitive_distance(shapes, shape, x, y, z)
    return distance


@compiled
def distances_to(scene: Scene, shape: int, points: FloatArray) -> npt.NDArray[np.float64]:
    """Return the signed distances from points of the object's frame, shape (n, 3), to one occlusion."""
    shapes, distances = scene.shapes, np.empty(len(points))
    for i in range(len(points)):
        distances[i] = distance_to(shapes, scene, shape, points[i, 0], points[i, 1], points[i, 2])
    return distances
