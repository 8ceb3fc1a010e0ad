"""The best free grasps by a straightforward scan: every shape for every grasp, then sort."""

from __future__ import annotations

import numpy as np
from numba import njit

from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.blocking import APPROACH, place_segment, segment_meets
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.hand_volume import PackedVolume
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Shape, Sphere, make_scene
from mebo_grasp.solutions.shapes import BoolArray
from mebo_grasp.solutions.signed_distance import Scene, rotation_matrix
from mebo_grasp.solutions.stored_grasps import StoredGrasps


def scan_by_tcp(stored: StoredGrasps, occlusions: tuple[Occlusion, ...], count: int) -> FloatArray:
    """Return the qualities of the best grasps whose TCP is free, in numpy, without the package's distances.

    Args:
        stored: all grasps.
        occlusions: of primitives without margins.
        count: how many qualities at most.
    """
    positions = stored.positions.array
    is_free = np.ones(len(positions), dtype=bool)
    for occlusion in occlusions:
        local = (positions - occlusion.T_object_shape.position) @ occlusion.T_object_shape.matrix[:3, :3]
        is_free &= ~_contains(occlusion.shape, local)
    return _best(stored, is_free, count)


def scan_by_hand(
    stored: StoredGrasps, occlusions: tuple[Occlusion, ...], approach: FloatArray, count: int
) -> FloatArray:
    """Return the qualities of the best grasps whose hand and approach are free, compiled.

    Args:
        stored: all grasps with their volumes.
        occlusions: of any shape.
        approach: where the approach begins, in the TCP's frame, shape (3,), metres.
        count: how many qualities at most.
    """
    is_free = _is_hand_free(
        make_scene(occlusions),
        stored.positions.array,
        stored.quaternions.array,
        stored.first_capsule.array,
        stored.capsules.array,
        approach,
    )
    return _best(stored, is_free, count)


def _best(stored: StoredGrasps, is_free: BoolArray, count: int) -> FloatArray:
    best: FloatArray = np.sort(stored.qualities.array[is_free])[::-1][:count]
    return best


def _contains(shape: Shape, p: FloatArray) -> BoolArray:
    if isinstance(shape, Box):
        return np.asarray(np.all(np.abs(p) <= np.array(shape.size) / 2, axis=1))
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(p, axis=1) <= shape.radius)
    if isinstance(shape, Cylinder):
        return (np.abs(p[:, 2]) <= shape.height / 2) & (np.hypot(p[:, 0], p[:, 1]) <= shape.radius)
    assert isinstance(shape, Cone)
    radii = shape.radius * (0.5 - p[:, 2] / shape.height)
    return (np.abs(p[:, 2]) <= shape.height / 2) & (np.hypot(p[:, 0], p[:, 1]) <= radii)


@njit(nogil=True)
def _is_hand_free(
    scene: Scene,
    positions: FloatArray,
    quaternions: FloatArray,
    first_capsule: IntArray,
    capsules: PackedVolume,
    approach: FloatArray,
) -> BoolArray:
    is_free, segment = np.ones(len(positions), np.bool_), np.empty((1, 8))
    for i in range(len(positions)):
        R = rotation_matrix(quaternions[i])
        own = capsules[first_capsule[i] : first_capsule[i + 1]]
        for k in range(APPROACH, len(own)):
            place_segment(R, positions[i], own, approach, k, segment[0])
            for shape in range(len(scene.shapes)):
                if segment_meets(scene.shapes, scene, shape, segment, 0):
                    is_free[i] = False
                    break
            if not is_free[i]:
                break
    return is_free
