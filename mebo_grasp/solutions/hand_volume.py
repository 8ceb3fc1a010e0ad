"""The room that a hand takes up, as capsules in its TCP's frame.

A capsule is all that lies within its radius of a segment; a sphere is a capsule whose segment is a point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.compiling import compiled
from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import FloatArray, Grasp
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.signed_distance import write_rotation

UNIT = 2e-5
"""Stored coordinates are multiples of 20 micrometres: 14 bytes a capsule, up to 0.65 m from the TCP."""

_LARGEST = (2**15 - 1) * UNIT
# Rounding moves a capsule's end by at most half a unit along each axis: the radius makes up for it.
_ROUNDING = 0.5 * np.sqrt(3.0) * UNIT

PackedVolume = npt.NDArray[np.int16]
"""Capsules in units of ``UNIT``, shape (m, 7): both ends of the segment and the radius."""

HandVolumeOf = Callable[[Grasp], "HandVolume"]
"""Tells the volume of the hand that made a grasp, from its final posture."""


@dataclass(frozen=True, eq=False)
class HandVolume:
    """Capsules in the TCP's frame.

    Args:
        starts: one end of each segment, shape (m, 3), m >= 1, metres.
        ends: the other end, shape (m, 3), metres.
        radii: shape (m,), metres, above 0.

    Raises:
        InvalidHandError: the shapes do not match, a number is not finite, a radius is not positive, or
            a capsule is more than 0.65 m away from the TCP.
    """

    starts: FloatArray
    ends: FloatArray
    radii: FloatArray

    def __post_init__(self) -> None:
        starts, ends, radii = (np.array(values, dtype=np.float64) for values in (self.starts, self.ends, self.radii))
        m = len(radii)
        if m < 1 or radii.shape != (m,) or starts.shape != (m, 3) or ends.shape != (m, 3):
            raise InvalidHandError(
                "a hand volume needs m >= 1 capsules: starts and ends of shape (m, 3), radii of shape (m,); "
                f"got {starts.shape}, {ends.shape} and {radii.shape}"
            )
        numbers = np.concatenate([starts.ravel(), ends.ravel(), radii])
        if not np.all(np.isfinite(numbers)) or np.abs(numbers).max() > _LARGEST - 2 * UNIT:
            raise InvalidHandError(
                f"capsules of a hand must be finite and within {_LARGEST:.3f} m of the TCP, got one at "
                f"{np.abs(numbers).max():.3g} m"
            )
        if radii.min() <= 0.0:
            raise InvalidHandError(f"radii of capsules must be above 0 m, got {radii.min()}")
        for name, values in (("starts", starts), ("ends", ends), ("radii", radii)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def packed(self) -> PackedVolume:
        """Return the capsules as they are stored: rounded, and thickened so that nothing is lost."""
        ends = np.rint(np.hstack([self.starts, self.ends]) / UNIT)
        radii = np.ceil((self.radii + _ROUNDING) / UNIT)
        return np.hstack([ends, radii[:, None]]).astype(np.int16)

    @classmethod
    def from_packed(cls, packed: PackedVolume) -> HandVolume:
        """Return the capsules that are stored."""
        capsules = packed.astype(np.float64) * UNIT
        return cls(capsules[:, 0:3], capsules[:, 3:6], capsules[:, 6])


def bounding_balls(
    positions: FloatArray, quaternions: FloatArray, first_capsule: IntArray, capsules: PackedVolume
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for each grasp a point, a radius within which all is hand, and one outside of which none is.

    The outer radius holds the TCP as well.

    The point is the middle of the thickest capsule, usually the palm.

    Args:
        positions: of the TCP in the object's frame, shape (n, 3), metres.
        quaternions: xyzw, shape (n, 4).
        first_capsule: capsules of grasp i are the rows ``first_capsule[i]`` to ``first_capsule[i + 1]``,
            shape (n + 1,).
        capsules: in the TCP's frame, shape (c, 7).

    Returns:
        Points in the object's frame, shape (n, 3); inner and outer radii, shape (n,), metres. A grasp
        without capsules has the TCP and radii of 0.
    """
    n = len(positions)
    centers, inner, outer = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    if len(capsules):
        _balls_in_tcp_frame(first_capsule, capsules, centers, inner, outer)
    # Read-only arrays would be compiled for once more.
    positions, quaternions = (np.require(a, None, ["C", "W"]) for a in (positions, quaternions))
    _to_object_frame(positions, quaternions, centers)
    return centers, inner, outer


@compiled
def _to_object_frame(positions: FloatArray, quaternions: FloatArray, points: FloatArray) -> None:
    """Move points, one in each TCP's frame, into the object's."""
    R = np.empty((3, 3))
    for i in range(len(points)):
        write_rotation(quaternions[i], R)
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for axis in range(3):
            points[i, axis] = positions[i, axis] + R[axis, 0] * x + R[axis, 1] * y + R[axis, 2] * z


@compiled
def _balls_in_tcp_frame(
    first_capsule: IntArray,
    capsules: PackedVolume,
    centers: FloatArray,
    inner: FloatArray,
    outer: FloatArray,
) -> None:
    for i in range(len(centers)):
        begin, end = first_capsule[i], first_capsule[i + 1]
        if begin == end:
            continue
        thickest = begin
        for k in range(begin, end):
            if capsules[k, 6] > capsules[thickest, 6]:
                thickest = k
        for axis in range(3):
            centers[i, axis] = 0.5 * UNIT * (capsules[thickest, axis] + capsules[thickest, 3 + axis])
        # A hair less, so that rounding never calls a hand blocked that only touches.
        inner[i] = capsules[thickest, 6] * UNIT * (1.0 - 1e-9)
        # The TCP is within the outer radius too: that is where the approach path ends.
        outer[i] = math.sqrt(np.sum(centers[i] ** 2))
        for k in range(begin, end):
            for side in (0, 3):
                squared = 0.0
                for axis in range(3):
                    squared += (capsules[k, side + axis] * UNIT - centers[i, axis]) ** 2
                outer[i] = max(outer[i], math.sqrt(squared) + capsules[k, 6] * UNIT)
        outer[i] *= 1.0 + 1e-9
