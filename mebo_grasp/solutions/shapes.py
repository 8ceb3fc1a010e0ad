"""The shapes that can block a grasp, each in a frame of its own: origin at the middle, axis along z.

The conventions are those of ``shape_msgs/SolidPrimitive``. The boundary belongs to the shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.bounding_tree import BoundingTree, build_tree
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.signed_distance import BOX, CONE, CYLINDER, MESH, SPHERE

MESH_LEAF_SIZE = 4
LARGEST_MESH = 1_000_000
"""Faces that a mesh may have; simplify larger ones."""

Sizes = tuple[float, float, float]


def _require_positive(shape: str, **lengths: float) -> None:
    for name, length in lengths.items():
        if not math.isfinite(length) or length <= 0.0:
            raise InvalidOcclusionError(f"{shape}: {name} must be finite and above 0 m, got {length}")


@dataclass(frozen=True)
class Box:
    """A box centred at the origin.

    Args:
        size: full edge lengths along x, y and z, metres.

    Raises:
        InvalidOcclusionError: there are not three lengths, or one is not finite and positive.
    """

    kind: ClassVar[int] = BOX
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if len(self.size) != 3:
            raise InvalidOcclusionError(f"box: size needs x, y and z, got {len(self.size)} lengths")
        x, y, z = (float(length) for length in self.size)
        _require_positive("box", x=x, y=y, z=z)
        object.__setattr__(self, "size", (x, y, z))

    @property
    def sizes(self) -> Sizes:
        """Half edges."""
        x, y, z = self.size
        return (x / 2.0, y / 2.0, z / 2.0)

    @property
    def bounding_radius(self) -> float:
        """Radius about the origin outside of which nothing of the shape is, metres."""
        return math.hypot(*self.size) / 2.0


@dataclass(frozen=True)
class Sphere:
    """A ball centred at the origin.

    Args:
        radius: metres.

    Raises:
        InvalidOcclusionError: the radius is not finite and positive.
    """

    kind: ClassVar[int] = SPHERE
    radius: float

    def __post_init__(self) -> None:
        _require_positive("sphere", radius=self.radius)

    @property
    def sizes(self) -> Sizes:
        """The radius."""
        return (self.radius, 0.0, 0.0)

    @property
    def bounding_radius(self) -> float:
        """Radius about the origin outside of which nothing of the shape is, metres."""
        return self.radius


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z that reaches from -height/2 to height/2.

    Args:
        height: metres.
        radius: metres.

    Raises:
        InvalidOcclusionError: a length is not finite and positive.
    """

    kind: ClassVar[int] = CYLINDER
    height: float
    radius: float

    def __post_init__(self) -> None:
        _require_positive("cylinder", height=self.height, radius=self.radius)

    @property
    def sizes(self) -> Sizes:
        """Half height and radius."""
        return (self.height / 2.0, self.radius, 0.0)

    @property
    def bounding_radius(self) -> float:
        """Radius about the origin outside of which nothing of the shape is, metres."""
        return math.hypot(self.height / 2.0, self.radius)


@dataclass(frozen=True)
class Cone:
    """A cone about z with its base at -height/2 and its apex at height/2.

    Args:
        height: metres.
        radius: of the base, metres.

    Raises:
        InvalidOcclusionError: a length is not finite and positive.
    """

    kind: ClassVar[int] = CONE
    height: float
    radius: float

    def __post_init__(self) -> None:
        _require_positive("cone", height=self.height, radius=self.radius)

    @property
    def sizes(self) -> Sizes:
        """Half height and radius of the base."""
        return (self.height / 2.0, self.radius, 0.0)

    @property
    def bounding_radius(self) -> float:
        """Radius about the origin outside of which nothing of the shape is, metres."""
        return math.hypot(self.height / 2.0, self.radius)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles; a closed one blocks what lies inside as well, an open one its surface only.

    Args:
        vertices: shape (v, 3), metres.
        faces: rows of vertices, shape (f, 3).

    Raises:
        InvalidOcclusionError: there is no face, a number is not finite, a face names a vertex that is not
            there, or there are more than ``LARGEST_MESH`` faces.
    """

    kind: ClassVar[int] = MESH
    vertices: FloatArray
    faces: IntArray = field(repr=False)

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64)
        faces = np.array(self.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.all(np.isfinite(vertices)):
            raise InvalidOcclusionError("mesh: vertices must be finite and of shape (v, 3)")
        if faces.ndim != 2 or faces.shape[1] != 3 or not 1 <= len(faces) <= LARGEST_MESH:
            raise InvalidOcclusionError(
                f"mesh: faces must have shape (f, 3) with f from 1 to {LARGEST_MESH}, got {faces.shape}"
            )
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InvalidOcclusionError(
                f"mesh: faces name vertices {faces.min()} to {faces.max()}, there are {len(vertices)}"
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def sizes(self) -> Sizes:
        """1 for a closed mesh, 0 for an open one."""
        return (float(self.is_closed), 0.0, 0.0)

    @property
    def bounding_radius(self) -> float:
        """Radius about the origin outside of which nothing of the shape is, metres."""
        return float(np.linalg.norm(self.vertices[self.faces], axis=2).max())

    @cached_property
    def is_closed(self) -> bool:
        """Whether every edge belongs to two faces that run along it in opposite directions."""
        # Vertices at the same place are one: meshes from files repeat them face by face.
        _, same = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = same.reshape(-1)[self.faces]
        edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        forward = np.unique(edges, axis=0)
        backward = np.unique(edges[:, ::-1], axis=0)
        return len(forward) == len(edges) and np.array_equal(forward, backward)

    @cached_property
    def tree(self) -> tuple[BoundingTree, FloatArray]:
        """A tree over the faces, and their corners in its order, shape (f, 3, 3)."""
        corners = self.vertices[self.faces]
        tree = build_tree(corners.min(axis=1), corners.max(axis=1), MESH_LEAF_SIZE)
        return tree, corners[tree.order]


Shape = Box | Sphere | Cylinder | Cone | TriangleMesh

BoolArray = npt.NDArray[np.bool_]
