"""Regions in which no grasp may be used now.

Under the thesis's rule (section 7.4.3) a grasp is blocked when its TCP lies inside a region.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.shapes import BoolArray, Box, Cone, Cylinder, Shape, Sphere

__all__ = ["Box", "Cone", "Cylinder", "Occlusion", "Shape", "Sphere", "first_blocking"]

NOT_BLOCKED = -1


@dataclass(frozen=True)
class Occlusion:
    """A named shape somewhere on or around the object.

    Args:
        id: name, unique within a query; not empty.
        shape: box, sphere, cylinder or cone, in its own frame.
        T_object_shape: pose of the shape in the object's frame.

    Raises:
        InvalidOcclusionError: the name is empty.
    """

    id: str
    shape: Shape
    T_object_shape: Pose

    def __post_init__(self) -> None:
        if not self.id:
            raise InvalidOcclusionError("an occlusion needs a name that is not empty")

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points of the object's frame, shape (n, 3), metres, lie inside, shape (n,)."""
        local = (points - self.T_object_shape.position) @ self.T_object_shape.matrix[:3, :3]
        return self.shape.contains(local)


def require_unique_ids(occlusions: tuple[Occlusion, ...]) -> None:
    """Refuse two occlusions of one name.

    Raises:
        InvalidOcclusionError: a name occurs twice.
    """
    ids = [occlusion.id for occlusion in occlusions]
    repeated = sorted({name for name in ids if ids.count(name) > 1})
    if repeated:
        raise InvalidOcclusionError(
            f"occlusion names must be unique, these occur more than once: {', '.join(repeated)}"
        )


def first_blocking(occlusions: tuple[Occlusion, ...], tcp_positions: FloatArray) -> np.ndarray:
    """Return for each TCP the index of the first occlusion that contains it, or ``NOT_BLOCKED``.

    Args:
        occlusions: regions in the object's frame.
        tcp_positions: shape (n, 3), metres, object frame.

    Returns:
        Shape (n,), integers.
    """
    blocking = np.full(len(tcp_positions), NOT_BLOCKED, dtype=np.int64)
    for index, occlusion in enumerate(occlusions):
        still_free = np.flatnonzero(blocking == NOT_BLOCKED)
        inside = occlusion.contains(tcp_positions[still_free])
        blocking[still_free[inside]] = index
    return blocking
