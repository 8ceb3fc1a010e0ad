"""Whether the hand of a grasp meets an occlusion: what blocked the last grasps is asked first, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, uint64

from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.blocking import APPROACH, place_segment, segment_meets
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.grasp_columns import Grasps, Wanted
from mebo_grasp.solutions.signed_distance import Scene, distance_to, write_rotation

FREE = -1
MASKED_SHAPES = 63
"""Occlusions that a node can rule out for all below it; any further ones are asked at every grasp."""
RECENT = 6
"""Pairs of occlusion and segment that blocked a grasp of late: they are likely to block the next good one."""
MOST_SEGMENTS = 64
"""Segments of a hand for which there is room on the desk; for larger hands room is made each time."""


class Desk(NamedTuple):
    """What a search works with, made once for all its grasps.

    Args:
        recent: occlusion and segment of the last blockings, newest first; unused ones are ``FREE``;
            shape (RECENT, 2).
        R: rotation of the TCP, shape (3, 3).
        hand: placed segments, shape (MOST_SEGMENTS, 8).
    """

    recent: IntArray
    R: FloatArray
    hand: FloatArray


@njit(cache=True, nogil=True)
def is_masked_out(mask: int, shape: int) -> bool:
    """Tell whether a mask says that an occlusion is out of reach."""
    return shape < MASKED_SHAPES and (mask >> uint64(shape)) & uint64(1) == uint64(0)


@njit(cache=True, nogil=True)
def _remember(desk: Desk, shape: int, segment: int) -> None:
    """Put a blocking to the front."""
    place = 0
    while place < RECENT - 1 and (desk.recent[place, 0] != shape or desk.recent[place, 1] != segment):
        place += 1
    for i in range(place, 0, -1):
        desk.recent[i, 0], desk.recent[i, 1] = desk.recent[i - 1, 0], desk.recent[i - 1, 1]
    desk.recent[0, 0], desk.recent[0, 1] = shape, segment


@njit(cache=True, nogil=True)
def ask_recent(scene: Scene, grasps: Grasps, row: int, mask: int, wanted: Wanted, desk: Desk) -> int:
    """Return an occlusion that blocked of late and blocks this grasp with the same segment, or FREE.

    Args:
        scene: occlusions.
        grasps: all of them.
        row: the grasp.
        mask: occlusions that may be in reach.
        wanted: the question.
        desk: of the search.
    """
    if desk.recent[0, 0] == FREE:
        return FREE
    capsules = grasps.capsules[grasps.first_capsule[row] : grasps.first_capsule[row + 1]]
    write_rotation(grasps.quaternions[row], desk.R)
    for i in range(RECENT):
        shape, segment = desk.recent[i, 0], desk.recent[i, 1]
        if shape == FREE:
            return FREE
        if is_masked_out(mask, shape) or segment >= len(capsules):
            continue
        place_segment(desk.R, grasps.positions[row], capsules, wanted.approach, segment, desk.hand[0])
        if segment_meets(scene, shape, desk.hand, 0):
            _remember(desk, shape, segment)
            return int(shape)
    return FREE


@njit(cache=True, nogil=True)
def ask_hand(scene: Scene, grasps: Grasps, row: int, mask: int, wanted: Wanted, desk: Desk) -> int:
    """Return an occlusion that meets the hand or its approach, or FREE; arguments as of ``ask_recent``."""
    capsules = grasps.capsules[grasps.first_capsule[row] : grasps.first_capsule[row + 1]]
    m, approach = len(capsules), wanted.approach
    has_approach = approach[0] != 0.0 or approach[1] != 0.0 or approach[2] != 0.0
    hand = desk.hand if m < MOST_SEGMENTS else np.empty((m + 1, 8))
    write_rotation(grasps.quaternions[row], desk.R)
    for k in range(m):
        place_segment(desk.R, grasps.positions[row], capsules, approach, k, hand[k])
    if has_approach:
        place_segment(desk.R, grasps.positions[row], capsules, approach, APPROACH, hand[m])
    x, y, z = grasps.points[row, 0], grasps.points[row, 1], grasps.points[row, 2]
    for shape in range(len(scene.shapes)):
        if is_masked_out(mask, shape):
            continue
        # Where the shape is out of the hand's reach, only the approach can meet it.
        is_near = distance_to(scene, shape, x, y, z) <= grasps.outer[row]
        for k in range(0 if is_near else m, m + has_approach):
            if segment_meets(scene, shape, hand, k):
                _remember(desk, shape, APPROACH if k == m else k)
                return int(shape)
    return FREE
