"""The one place that speaks to PyBullet: exact gaps between a hand's shapes and the object."""

from __future__ import annotations

import weakref
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.engine import GAP_CALLBACK, QUERY_RANGE
from mebo_grasp.grasping.quiet_import import quiet_stderr
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.urdf import LinkShape

with quiet_stderr():
    import pybullet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

HULL_MARGIN = 1e-3
"""Bullet inflates every convex mesh by this much (metres); gaps and points are corrected for it."""

MOST_BODY_FACES = 40_000
"""Triangles of a slice. PyBullet takes no mesh of more than 131,072 vertices or 524,288 corners: a surface of three
times as many vertices and four times as many triangles is below both, and stays whole."""


def surface_pieces(vertices: FloatArray, faces: IntArray) -> list[tuple[FloatArray, IntArray]]:
    """Cut a surface that PyBullet would not take whole into slices, each (n, 3) vertices and (m, 3) faces.

    Slices are across the longest side, so that few of them are near to a shape.
    """
    if len(vertices) <= 3 * MOST_BODY_FACES and len(faces) <= 4 * MOST_BODY_FACES:
        return [(vertices, faces)]
    axis = int(np.ptp(vertices, axis=0).argmax())
    order = np.argsort(vertices[faces, axis].mean(axis=1), kind="stable")
    pieces = []
    for some in np.array_split(order, -(-len(faces) // MOST_BODY_FACES)):
        used, corners = np.unique(faces[some], return_inverse=True)
        pieces.append((vertices[used], corners.reshape(-1, 3)))
    return pieces


def bounding_radius(shape: LinkShape) -> float:
    """Return the radius of a ball about the origin of a shape's frame that holds the shape."""
    if shape.kind == "box":
        return float(np.linalg.norm(shape.dims)) / 2.0
    if shape.kind == "sphere":
        return shape.dims[0]
    if shape.kind == "mesh":
        return float(np.linalg.norm(np.asarray(shape.vertices), axis=1).max())
    radius, length = shape.dims
    return length / 2.0 + radius if shape.kind == "capsule" else float(np.hypot(length / 2.0, radius))


@njit(cache=True)
def place(T_parent: FloatArray, T_shape: FloatArray, out: FloatArray) -> None:
    """Write position and unit quaternion xyzw of ``T_parent @ T_shape``, both (4, 4), into ``out``, shape (7,)."""
    R = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R[i, j] += T_parent[i, k] * T_shape[k, j]
    for i in range(3):
        out[i] = T_parent[i, 3]
        for k in range(3):
            out[i] += T_parent[i, k] * T_shape[k, 3]
    # The largest of the four squared components is the safe one to divide by (Shepperd, 1978).
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    largest, best = 3, trace
    for k in range(3):
        if R[k, k] > best:
            largest, best = k, R[k, k]
    q = out[3:]
    if largest == 3:
        q[0], q[1], q[2], q[3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i], q[j], q[k] = 1.0 - trace + 2.0 * R[i, i], R[j, i] + R[i, j], R[k, i] + R[i, k]
        q[3] = R[k, j] - R[j, k]
    q /= np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


@njit(cache=True)
def near_boxes(center: FloatArray, radius: float, lower: FloatArray, upper: FloatArray, near: IntArray) -> int:
    """Write the indices of the boxes that a ball meets into ``near``; return how many."""
    count = 0
    for i in range(lower.shape[0]):
        apart2 = 0.0
        for k in range(3):
            apart = max(lower[i, k] - center[k], 0.0, center[k] - upper[i, k])
            apart2 += apart * apart
        if apart2 <= radius * radius:
            near[count] = i
            count += 1
    return count


class BulletWorld:
    """An object alone in a world without display, asked for its gap to single shapes.

    Each world has a client of its own, so several can live in one process.

    Args:
        target: the object; its convex parts become convex shapes, a bare surface a triangle mesh.
        shapes: the shapes that will be asked about, in the order of their indices.
        T_group_shape: (P, 4, 4) pose of each shape in the frame of its rigid group.
        pose: (4, 4) array in which the compiled loop writes a group's pose before it calls ``callback``.

    Attributes:
        callback: C function that returns the gap of a shape whose group stands at ``pose``.
    """

    def __init__(
        self, target: TargetObject, shapes: tuple[LinkShape, ...], T_group_shape: FloatArray, pose: FloatArray
    ) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        # Also of a world that is forgotten without being closed: an object in it takes tens of megabytes.
        self._disconnect = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        self.stand(T_group_shape, pose)
        self._error: BaseException | None = None
        self.callback = GAP_CALLBACK(self._answer)
        self._margin_object = HULL_MARGIN if target.solid_parts else 0.0
        if target.solid_parts:
            parts = list(target.solid_parts)
            self._bodies = [self._part_body(part) for part in parts]
        else:
            pieces = surface_pieces(np.asarray(target.mesh.vertices), np.asarray(target.mesh.faces))
            parts = [vertices for vertices, _ in pieces]
            self._bodies = [self._surface_body(*piece) for piece in pieces]
        self._shapes = [self._hand_shape(shape) for shape in shapes]
        self._placed = np.empty(7)
        self._balls = [bounding_radius(shape) for shape in shapes]
        self._lower = np.array([part.min(axis=0) for part in parts])
        self._upper = np.array([part.max(axis=0) for part in parts])
        self._near = np.empty(len(parts), dtype=np.int64)
        self._margins = [HULL_MARGIN if shape.kind == "mesh" else 0.0 for shape in shapes]

    def stand(self, T_group_shape: FloatArray, pose: FloatArray) -> None:
        """Take the same shapes at other poses in their groups, and another array for a group's pose."""
        self._T_group_shape = np.ascontiguousarray(T_group_shape)
        self._pose = pose

    def _part_body(self, part: FloatArray) -> int:
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=part.tolist(), physicsClientId=self._client)
        return int(pybullet.createMultiBody(0, shape, physicsClientId=self._client))

    def _surface_body(self, vertices: FloatArray, faces: IntArray) -> int:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices.tolist(),
            indices=faces.reshape(-1).tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=self._client,
        )
        return int(pybullet.createMultiBody(0, shape, physicsClientId=self._client))

    def _hand_shape(self, shape: LinkShape) -> int:
        kwargs: dict[str, object] = {"physicsClientId": self._client}
        if shape.kind == "box":
            kind = pybullet.GEOM_BOX
            kwargs["halfExtents"] = [side / 2.0 for side in shape.dims]
        elif shape.kind == "sphere":
            kind = pybullet.GEOM_SPHERE
            kwargs["radius"] = shape.dims[0]
        elif shape.kind == "mesh":
            kind = pybullet.GEOM_MESH
            kwargs["vertices"] = np.asarray(shape.vertices).tolist()
        else:
            kind = pybullet.GEOM_CAPSULE if shape.kind == "capsule" else pybullet.GEOM_CYLINDER
            kwargs["radius"], kwargs["height"] = shape.dims
        return int(pybullet.createCollisionShape(kind, **kwargs))

    def closest(
        self, index: int, T_object_group: FloatArray, reach: float = QUERY_RANGE
    ) -> tuple[float, tuple[float, float, float] | None, tuple[float, float, float] | None]:
        """Return the gap between a shape and the object, the object's point, and the direction into the object.

        Args:
            index: the shape.
            T_object_group: pose of the shape's group in the object's frame, (4, 4).
            reach: gaps beyond this are reported as ``reach`` without a point, metres.
        """
        margin = self._margin_object + self._margins[index]
        best, point, direction = reach, None, None
        for hit in self._hits(index, T_object_group, reach):
            gap = hit[8] + margin
            if gap < best:
                best, point, direction = gap, hit[5], hit[7]
        if point is None or direction is None:
            return reach, None, None
        # Bullet's normal points from the shape (B) to the object (A); the object's point lies on its margin.
        inward = (float(direction[0]), float(direction[1]), float(direction[2]))
        on_surface = tuple(float(point[k]) + inward[k] * self._margin_object for k in range(3))
        return float(best), (on_surface[0], on_surface[1], on_surface[2]), inward

    def _hits(self, index: int, T_object_group: FloatArray, reach: float) -> list[tuple[Any, ...]]:
        """Return PyBullet's closest points between a shape and every part of the object near it."""
        place(T_object_group, self._T_group_shape[index], self._placed)
        placed = self._placed.tolist()
        if len(self._bodies) == 1:
            near = self._bodies
        else:
            count = near_boxes(self._placed, self._balls[index] + reach, self._lower, self._upper, self._near)
            near = [self._bodies[i] for i in self._near[:count].tolist()]
        hits: list[tuple[Any, ...]] = []
        for body in near:
            hits += pybullet.getClosestPoints(
                bodyA=body,
                bodyB=-1,
                distance=reach - self._margin_object - self._margins[index],
                collisionShapeB=self._shapes[index],
                collisionShapePositionB=placed[:3],
                collisionShapeOrientationB=placed[3:],
                physicsClientId=self._client,
            )
        return hits

    def _answer(self, index: int) -> float:
        try:
            gap = QUERY_RANGE
            for hit in self._hits(index, self._pose, QUERY_RANGE):
                gap = min(gap, hit[8] + self._margin_object + self._margins[index])
            return gap
        except BaseException as error:
            # An exception cannot pass through compiled code; it is kept and raised when that has returned.
            self._error = error
            return 0.0

    def raise_pending(self) -> None:
        """Raise what went wrong within the callback, if anything did."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def close(self) -> None:
        """Free the world; closing twice does no harm."""
        self._disconnect()

    def __enter__(self) -> BulletWorld:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
