"""Whether a grasp is blocked by an occlusion, compiled."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np
from numba import njit

from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.hand_volume import UNIT, PackedVolume
from mebo_grasp.solutions.signed_distance import MESH, Scene, distance_in_shape_frame

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


@njit(cache=True, nogil=True)
def rotation_matrix(q: FloatArray) -> FloatArray:
    """Return the matrix of a unit quaternion xyzw, shape (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return R


@njit(cache=True, nogil=True)
def _at(scene: Scene, shape: int, a: FloatArray, along: FloatArray, t: float) -> float:
    x, y, z = a[0] + t * along[0], a[1] + t * along[1], a[2] + t * along[2]
    return float(distance_in_shape_frame(scene, shape, x, y, z))


@njit(cache=True, nogil=True)
def _segment_meets_convex(scene: Scene, shape: int, a: FloatArray, along: FloatArray, reach: float) -> bool:
    """Find the least distance along the segment by golden sections: it is a convex function of t."""
    length = math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    low, high = 0.0, 1.0
    t_1, t_2 = 1.0 - _GOLDEN, _GOLDEN
    d_1, d_2 = _at(scene, shape, a, along, t_1), _at(scene, shape, a, along, t_2)
    while min(d_1, d_2) > reach:
        # The distance changes by no more than the point moves: the rest of the segment may be out of reach.
        width = (high - low) * length
        if min(d_1, d_2) - (1.0 - _GOLDEN) * width > reach or width < RESOLUTION:
            return False
        if d_1 <= d_2:
            high, t_2, d_2 = t_2, t_1, d_1
            t_1 = high - _GOLDEN * (high - low)
            d_1 = _at(scene, shape, a, along, t_1)
        else:
            low, t_1, d_1 = t_1, t_2, d_2
            t_2 = low + _GOLDEN * (high - low)
            d_2 = _at(scene, shape, a, along, t_2)
    return True


@njit(cache=True, nogil=True)
def _segment_meets_mesh(scene: Scene, shape: int, a: FloatArray, along: FloatArray, reach: float) -> bool:
    """Halve the segment wherever it may be in reach, down to ``MESH_RESOLUTION``."""
    length = math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    middles, halves = np.empty(64), np.empty(64)
    middles[0], halves[0] = 0.5, 0.5
    depth = 1
    while depth > 0:
        depth -= 1
        middle, half = middles[depth], halves[depth]
        distance = _at(scene, shape, a, along, middle)
        if distance <= reach:
            return True
        if distance - half * length > reach:
            continue
        if half * length < MESH_RESOLUTION:
            return True
        middles[depth], middles[depth + 1] = middle - half / 2, middle + half / 2
        halves[depth], halves[depth + 1] = half / 2, half / 2
        depth += 2
    return False


@njit(cache=True, nogil=True)
def _segment_meets(scene: Scene, shape: int, a: FloatArray, along: FloatArray, radius: float) -> bool:
    reach = radius + scene.margins[shape]
    half = 0.5 * math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    distance = _at(scene, shape, a, along, 0.5)
    if distance <= reach:
        return True
    if distance - half > reach:
        return False
    if scene.kinds[shape] == MESH:
        return bool(_segment_meets_mesh(scene, shape, a, along, reach))
    return bool(_segment_meets_convex(scene, shape, a, along, reach))


@njit(cache=True, nogil=True)
def _turn(R: FloatArray, v: FloatArray, out: FloatArray) -> None:
    for row in range(3):
        out[row] = R[row, 0] * v[0] + R[row, 1] * v[1] + R[row, 2] * v[2]


@njit(cache=True, nogil=True)
def hand_meets(
    scene: Scene,
    shape: int,
    position: FloatArray,
    quaternion: FloatArray,
    capsules: PackedVolume,
    approach: FloatArray,
) -> bool:
    """Tell whether a hand or its approach path meets an occlusion.

    Args:
        scene: occlusions in the object's frame.
        shape: index of the occlusion.
        position: of the TCP in the object's frame, shape (3,).
        quaternion: xyzw, shape (4,).
        capsules: the hand in the TCP's frame, shape (m, 7).
        approach: where the approach begins, in the TCP's frame, shape (3,); zero for none.
    """
    R = scene.rotations[shape].T.copy()
    R_shape_tcp = R @ rotation_matrix(quaternion)
    offset, origin = np.empty(3), position - scene.origins[shape]
    _turn(R, origin, offset)
    a, along, local = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(capsules)):
        for axis in range(3):
            local[axis] = capsules[k, axis] * UNIT
        _turn(R_shape_tcp, local, a)
        for axis in range(3):
            a[axis] += offset[axis]
            local[axis] = (capsules[k, 3 + axis] - capsules[k, axis]) * UNIT
        _turn(R_shape_tcp, local, along)
        if _segment_meets(scene, shape, a, along, capsules[k, 6] * UNIT):
            return True
    if approach[0] == 0.0 and approach[1] == 0.0 and approach[2] == 0.0:
        return False
    _turn(R_shape_tcp, approach, along)
    return bool(_segment_meets(scene, shape, offset, along, 0.0))
