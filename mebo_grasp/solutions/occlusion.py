"""Regions in which no grasp may be used now."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.bounding_tree import LEAF, BoundingTree
from mebo_grasp.solutions.shapes import (
    BoolArray,
    Box,
    Cone,
    Cylinder,
    Shape,
    Sphere,
    TriangleMesh,
)
from mebo_grasp.solutions.signed_distance import (
    COLUMNS,
    Scene,
    distances_to,
    rotation_matrix,
)

__all__ = ["Box", "Cone", "Cylinder", "Occlusion", "Shape", "Sphere", "TriangleMesh", "make_scene"]


@dataclass(frozen=True)
class Occlusion:
    """A named shape somewhere on or around the object.

    Args:
        id: name, unique within a query; not empty.
        shape: box, sphere, cylinder, cone or triangle mesh, in its own frame.
        T_object_shape: pose of the shape in the object's frame.
        margin: by which the shape is thickened all around, metres.

    Raises:
        InvalidOcclusionError: the name is empty, or the margin is negative or not finite.
    """

    id: str
    shape: Shape
    T_object_shape: Pose
    margin: float = 0.0

    def __post_init__(self) -> None:
        if not self.id:
            raise InvalidOcclusionError("an occlusion needs a name that is not empty")
        if not math.isfinite(self.margin) or self.margin < 0.0:
            raise InvalidOcclusionError(
                f"occlusion '{self.id}': margin must be finite and at least 0 m, got {self.margin}"
            )

    @cached_property
    def columns(self) -> FloatArray:
        """All that a ``Scene`` says of it except for the place of its triangles."""
        R = rotation_matrix(self.T_object_shape.quaternion_xyzw)
        position = self.T_object_shape.position
        # A hair more, so that rounding never puts a point of the shape outside.
        reach = (self.shape.bounding_radius + self.margin) * (1.0 + 1e-9)
        return np.array([self.shape.kind, *self.shape.sizes, *R.flat, *position, self.margin, reach])

    @cached_property
    def _scene(self) -> Scene:
        return make_scene((self,))

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the distances from points to the thickened shape, negative inside.

        Args:
            points: of the object's frame, shape (n, 3), metres.

        Returns:
            Shape (n,), metres. Inside, with a margin, an upper bound of the true value.
        """
        rows = np.ascontiguousarray(points, dtype=np.float64)
        distances: FloatArray = distances_to(self._scene, 0, rows)
        return distances

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points of the object's frame, shape (n, 3), metres, lie inside, shape (n,)."""
        inside: BoolArray = self.signed_distance(points) <= 0.0
        return inside


def make_scene(occlusions: tuple[Occlusion, ...]) -> Scene:
    """Gather occlusions into the arrays that the compiled searches read."""
    shapes = np.zeros((len(occlusions), COLUMNS))
    triangles: list[FloatArray] = [np.empty((0, 3, 3))]
    trees: list[BoundingTree] = []
    first_triangle = root = 0
    for row, occlusion in zip(shapes, occlusions, strict=True):
        row[:-2] = occlusion.columns
        if isinstance(occlusion.shape, TriangleMesh):
            row[-2:] = first_triangle, root
            tree, corners = occlusion.shape.tree
            trees.append(tree._replace(left=np.where(tree.left == LEAF, LEAF, tree.left + root)))
            triangles.append(corners)
            first_triangle += len(corners)
            root += len(tree.left)
    return Scene(shapes, np.concatenate(triangles), _join(trees))


def _join(trees: list[BoundingTree]) -> BoundingTree:
    if not trees:
        none, nowhere = np.empty(0, dtype=np.int64), np.empty((0, 3))
        return BoundingTree(none, none, none, none, nowhere, nowhere)
    return BoundingTree(*(np.concatenate(parts) for parts in zip(*trees, strict=True)))
