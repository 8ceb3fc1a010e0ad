"""The shapes that can block a grasp, each in a frame of its own: origin at the middle, axis along z.

The conventions are those of ``shape_msgs/SolidPrimitive``. The boundary belongs to the shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import FloatArray

BoolArray = npt.NDArray[np.bool_]


class Shape(Protocol):
    """What an occluding shape can tell about points in its own frame."""

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which of the points, shape (n, 3), metres, lie inside or on the boundary, shape (n,)."""
        ...


def _require_positive(shape: str, **lengths: float) -> None:
    for name, length in lengths.items():
        if not math.isfinite(length) or length <= 0.0:
            raise InvalidOcclusionError(
                f"{shape}: {name} must be finite and above 0 m, got {length}"
            )


@dataclass(frozen=True)
class Box:
    """A box centred at the origin.

    Args:
        size: full edge lengths along x, y and z, metres.

    Raises:
        InvalidOcclusionError: there are not three lengths, or one is not finite and positive.
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if len(self.size) != 3:
            raise InvalidOcclusionError(f"box: size needs x, y and z, got {len(self.size)} lengths")
        x, y, z = (float(length) for length in self.size)
        _require_positive("box", x=x, y=y, z=z)
        object.__setattr__(self, "size", (x, y, z))

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which of the points, shape (n, 3), lie inside, shape (n,)."""
        inside: BoolArray = np.all(np.abs(points) <= np.array(self.size) / 2.0, axis=1)
        return inside


@dataclass(frozen=True)
class Sphere:
    """A ball centred at the origin.

    Args:
        radius: metres.

    Raises:
        InvalidOcclusionError: the radius is not finite and positive.
    """

    radius: float

    def __post_init__(self) -> None:
        _require_positive("sphere", radius=self.radius)

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which of the points, shape (n, 3), lie inside, shape (n,)."""
        inside: BoolArray = np.linalg.norm(points, axis=1) <= self.radius
        return inside


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z that reaches from -height/2 to height/2.

    Args:
        height: metres.
        radius: metres.

    Raises:
        InvalidOcclusionError: a length is not finite and positive.
    """

    height: float
    radius: float

    def __post_init__(self) -> None:
        _require_positive("cylinder", height=self.height, radius=self.radius)

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which of the points, shape (n, 3), lie inside, shape (n,)."""
        inside: BoolArray = (np.abs(points[:, 2]) <= self.height / 2.0) & (
            np.hypot(points[:, 0], points[:, 1]) <= self.radius
        )
        return inside


@dataclass(frozen=True)
class Cone:
    """A cone about z with its base at -height/2 and its apex at height/2.

    Args:
        height: metres.
        radius: of the base, metres.

    Raises:
        InvalidOcclusionError: a length is not finite and positive.
    """

    height: float
    radius: float

    def __post_init__(self) -> None:
        _require_positive("cone", height=self.height, radius=self.radius)

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which of the points, shape (n, 3), lie inside, shape (n,)."""
        z = points[:, 2]
        radius_there = self.radius * (0.5 - z / self.height)
        inside: BoolArray = (np.abs(z) <= self.height / 2.0) & (
            np.hypot(points[:, 0], points[:, 1]) <= radius_there
        )
        return inside
