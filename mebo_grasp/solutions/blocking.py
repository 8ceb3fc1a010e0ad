"""Whether a grasp is blocked by an occlusion, compiled."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from mebo_grasp.compiling import borrowing, borrowing_inlined, compiled
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.hand_volume import UNIT, PackedVolume
from mebo_grasp.solutions.signed_distance import (
    MESH,
    Scene,
    is_beyond,
    mesh_distance,
    primitive_distance,
)

RESOLUTION = 1e-6
"""Length of the piece of a segment on which the nearest point is not searched further, metres."""
MESH_RESOLUTION = 5e-5
"""The same for triangle meshes; what is nearer than half of this counts as touching."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


class BlockingRule(StrEnum):
    """When a grasp counts as blocked."""

    TCP = "tcp"
    """Its TCP lies in an occlusion: the rule of the thesis, section 7.4.3."""
    HAND = "hand"
    """The hand in its final posture, or its straight approach path, meets an occlusion."""


APPROACH = -1
"""Number of the segment along which the TCP arrives; the others are those of the capsules."""


@borrowing_inlined
def place_segment(
    R: FloatArray,
    position: FloatArray,
    capsules: PackedVolume,
    approach: FloatArray,
    k: int,
    placed: FloatArray,
) -> None:
    """Write one segment of a hand in the object's frame: its middle, half of it, half its length, its radius.

    Args:
        R: rotation of the TCP in the object's frame, shape (3, 3).
        position: of the TCP in the object's frame, shape (3,), metres.
        capsules: the hand in the TCP's frame, shape (m, 7).
        approach: where the approach begins, in the TCP's frame, shape (3,), metres.
        k: number of the segment, or ``APPROACH``.
        placed: to be written, shape (8,).
    """
    if k == APPROACH:
        mx, my, mz = 0.5 * approach[0], 0.5 * approach[1], 0.5 * approach[2]
        hx, hy, hz, radius = mx, my, mz, 0.0
    else:
        half_unit = 0.5 * UNIT
        mx, hx = half_unit * (capsules[k, 3] + capsules[k, 0]), half_unit * (capsules[k, 3] - capsules[k, 0])
        my, hy = half_unit * (capsules[k, 4] + capsules[k, 1]), half_unit * (capsules[k, 4] - capsules[k, 1])
        mz, hz = half_unit * (capsules[k, 5] + capsules[k, 2]), half_unit * (capsules[k, 5] - capsules[k, 2])
        radius = capsules[k, 6] * UNIT
    for axis in range(3):
        placed[axis] = position[axis] + R[axis, 0] * mx + R[axis, 1] * my + R[axis, 2] * mz
        placed[3 + axis] = R[axis, 0] * hx + R[axis, 1] * hy + R[axis, 2] * hz
    placed[6] = math.sqrt(hx * hx + hy * hy + hz * hz)
    placed[7] = radius


@borrowing
def _at(shapes: FloatArray, shape: int, hand: FloatArray, k: int, t: float) -> float:
    """Return the distance of a primitive from the point of segment k at t in [-1, 1]."""
    x = hand[k, 0] + t * hand[k, 3]
    y = hand[k, 1] + t * hand[k, 4]
    z = hand[k, 2] + t * hand[k, 5]
    return float(primitive_distance(shapes, shape, x, y, z))


@borrowing
def _segment_meets_convex(shapes: FloatArray, shape: int, hand: FloatArray, k: int) -> bool:
    """Find the least distance along the segment by golden sections: it is a convex function of t."""
    half, radius = hand[k, 6], hand[k, 7]
    middle = _at(shapes, shape, hand, k, 0.0)
    if middle <= radius:
        return True
    if middle - half > radius:
        return False
    low, high = -1.0, 1.0
    t_1, t_2 = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    d_1, d_2 = _at(shapes, shape, hand, k, t_1), _at(shapes, shape, hand, k, t_2)
    while min(d_1, d_2) > radius:
        # The distance changes by no more than the point moves: the rest of the segment may be out of reach.
        width = (high - low) * half
        if min(d_1, d_2) - (1.0 - _GOLDEN) * width > radius or width < RESOLUTION:
            return False
        if d_1 <= d_2:
            high, t_2, d_2 = t_2, t_1, d_1
            t_1 = high - _GOLDEN * (high - low)
            d_1 = _at(shapes, shape, hand, k, t_1)
        else:
            low, t_1, d_1 = t_1, t_2, d_2
            t_2 = low + _GOLDEN * (high - low)
            d_2 = _at(shapes, shape, hand, k, t_2)
    return True


@compiled
def _segment_meets_mesh(scene: Scene, shape: int, hand: FloatArray, k: int) -> bool:
    """Halve the segment wherever it may be in reach, down to ``MESH_RESOLUTION``."""
    half, radius = hand[k, 6], hand[k, 7]
    middles, widths = np.empty(64), np.empty(64)
    middles[0], widths[0] = 0.0, 1.0
    depth = 1
    while depth > 0:
        depth -= 1
        middle, width = middles[depth], widths[depth]
        x = hand[k, 0] + middle * hand[k, 3]
        y = hand[k, 1] + middle * hand[k, 4]
        z = hand[k, 2] + middle * hand[k, 5]
        distance = mesh_distance(scene, shape, x, y, z)
        if distance <= radius:
            return True
        if distance - width * half > radius:
            continue
        if width * half < MESH_RESOLUTION:
            return True
        middles[depth], middles[depth + 1] = middle - width / 2, middle + width / 2
        widths[depth], widths[depth + 1] = width / 2, width / 2
        depth += 2
    return False


# Inlined by numba itself, for the reason that ``distance_to`` is.
@borrowing_inlined
def segment_meets(shapes: FloatArray, scene: Scene, shape: int, hand: FloatArray, k: int) -> bool:
    """Tell whether a segment of a hand meets an occlusion.

    Args:
        shapes: ``scene.shapes``.
        scene: occlusions in the object's frame.
        shape: index of the occlusion.
        hand: rows as ``place_segment`` writes them, shape (m, 8).
        k: row of the segment.
    """
    if is_beyond(shapes, shape, hand[k, 0], hand[k, 1], hand[k, 2], hand[k, 6] + hand[k, 7]):
        meets = False
    elif shapes[shape, 0] == MESH:
        meets = _segment_meets_mesh(scene, shape, hand, k)
    else:
        meets = _segment_meets_convex(shapes, shape, hand, k)
    return meets
