"""Whether the hand of a grasp meets an occlusion: what blocked the last grasps is asked first, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import uint64

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.blocking import APPROACH, place_segment, segment_meets
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.grasp_columns import Grasps, Wanted
from mebo_grasp.solutions.signed_distance import Scene, distance_to, is_beyond, write_rotation

FREE = -1
MASKED_SHAPES = 63
"""Occlusions that a node can rule out for all below it; any further ones are asked at every grasp."""
BALL = -2
"""Instead of a segment: the ball within which all is hand."""
RECENT = 6
"""Pairs of occlusion and segment that blocked a grasp of late: they are likely to block the next good one."""
MOST_SEGMENTS = 64
"""Segments for which a desk has room at first: the approach and those of a hand of 63 capsules."""


class Desk(NamedTuple):
    """What a search works with, made once for all its grasps.

    Args:
        recent: occlusion and segment of the last blockings, newest first; unused ones are ``FREE``;
            shape (RECENT, 2).
        R: rotation of the TCP, shape (3, 3).
        hand: placed segments, shape (room, 8).
        reaches: how far each segment reaches from the hand's middle, shape (room,), metres.
    """

    recent: IntArray
    R: FloatArray
    hand: FloatArray
    reaches: FloatArray


@compiled
def make_desk(room: int) -> Desk:
    """Return an empty desk with room for a number of segments, that of the approach among them."""
    return Desk(np.full((RECENT, 2), FREE), np.empty((3, 3)), np.empty((room, 8)), np.empty(room))


@borrowing
def segments_of(grasps: Grasps, row: int) -> int:
    """Return how many segments the hand of a grasp has, its approach among them."""
    return grasps.first_capsule[row + 1] - grasps.first_capsule[row] + 1


@borrowing
def is_masked_out(mask: int, shape: int) -> bool:
    """Tell whether a mask says that an occlusion is out of reach."""
    return shape < MASKED_SHAPES and (mask >> uint64(shape)) & uint64(1) == uint64(0)


@borrowing
def remember(desk: Desk, shape: int, segment: int) -> None:
    """Note at the first place which occlusion blocked a grasp, and with which segment."""
    recent, place = desk.recent, 0
    while place < RECENT - 1 and (recent[place, 0] != shape or recent[place, 1] != segment):
        place += 1
    for i in range(place, 0, -1):
        recent[i, 0], recent[i, 1] = recent[i - 1, 0], recent[i - 1, 1]
    recent[0, 0], recent[0, 1] = shape, segment


@borrowing
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
    shapes, recent, R, hand = scene.shapes, desk.recent, desk.R, desk.hand
    capsules = grasps.capsules[grasps.first_capsule[row] : grasps.first_capsule[row + 1]]
    position, point, inner = grasps.positions[row], grasps.points[row], grasps.inner[row]
    write_rotation(grasps.quaternions[row], R)
    for i in range(RECENT):
        shape, segment = recent[i, 0], recent[i, 1]
        if shape == FREE:
            break
        if is_masked_out(mask, shape) or segment >= len(capsules):
            continue
        if segment == BALL:
            meets = distance_to(shapes, scene, shape, point[0], point[1], point[2]) <= inner
        else:
            place_segment(R, position, capsules, wanted.approach, segment, hand[0])
            meets = segment_meets(shapes, scene, shape, hand, 0)
        if meets:
            remember(desk, shape, segment)
            return int(shape)
    return FREE


@borrowing
def ask_hand(scene: Scene, grasps: Grasps, row: int, mask: int, wanted: Wanted, desk: Desk) -> int:
    """Return an occlusion that meets the hand or its approach, or FREE; arguments as of ``ask_recent``."""
    capsules = grasps.capsules[grasps.first_capsule[row] : grasps.first_capsule[row + 1]]
    m, approach = len(capsules), wanted.approach
    has_approach = approach[0] != 0.0 or approach[1] != 0.0 or approach[2] != 0.0
    hand, reaches = desk.hand, desk.reaches
    shapes, R, position, outer = scene.shapes, desk.R, grasps.positions[row], grasps.outer[row]
    x, y, z = grasps.points[row, 0], grasps.points[row, 1], grasps.points[row, 2]
    write_rotation(grasps.quaternions[row], R)
    for k in range(m):
        place_segment(R, position, capsules, approach, k, hand[k])
        dx, dy, dz = hand[k, 0] - x, hand[k, 1] - y, hand[k, 2] - z
        # A hair more, so that rounding never puts a point of the segment out of reach.
        reaches[k] = (math.sqrt(dx * dx + dy * dy + dz * dz) + hand[k, 6] + hand[k, 7]) * (1.0 + 1e-9)
    if has_approach:
        place_segment(R, position, capsules, approach, APPROACH, hand[m])
    newest = desk.recent[0, 0]
    for turn in range(-1, len(shapes)):
        shape = newest if turn < 0 else turn
        if turn == newest or shape == FREE or is_masked_out(mask, shape):
            continue
        # Nearer than this no part of the shape is to the hand's middle.
        distance = np.inf
        if not is_beyond(shapes, shape, x, y, z, outer):
            distance = distance_to(shapes, scene, shape, x, y, z)
        # Where the shape is out of the hand's reach, only the approach can meet it.
        for k in range(0 if distance <= outer else m, m + has_approach):
            if k < m and reaches[k] < distance:
                continue
            if segment_meets(shapes, scene, shape, hand, k):
                remember(desk, shape, APPROACH if k == m else k)
                return int(shape)
    return FREE
