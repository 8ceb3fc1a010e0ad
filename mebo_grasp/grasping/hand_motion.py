"""Poses, gap bounds and self-distances of a hand in motion, compiled.

T is always a pose in the object's frame, (4, 4). For groups and shapes see ``hand_arrays``.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField, sample
from mebo_grasp.grasping.hand_arrays import (
    BOX,
    FREE_AT_START,
    MOST_FINGERS,
    MOST_GROUPS,
    MOST_JOINTS,
    MOST_SHAPES,
    HandArrays,
    drop_pairs,
    never_meeting_pairs,
)
from mebo_grasp.grasping.mesh_distance import segment_segment

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SELF_GAP_OF_INTEREST = 1e-3
"""Gaps between links beyond this need not be exact, metres."""
STILL_GAP_OF_INTEREST = 0.03
"""The same for gaps to the palm, which are remembered."""


POSES_TYPE = np.dtype(
    [
        ("T", np.float64, (4, 4)),
        ("joints", np.float64, (MOST_FINGERS, MOST_JOINTS)),
        ("group", np.float64, (MOST_GROUPS, 4, 4)),
        ("trial", np.float64, (MOST_JOINTS, 4, 4)),
        ("ends", np.float64, (MOST_SHAPES, 2, 3)),
        ("box_axes", np.float64, (MOST_SHAPES, 3, 3)),
        ("scratch", np.float64, (4, 3)),
        ("bound", np.float64, (MOST_SHAPES,)),
        ("still_bound", np.float64, (MOST_SHAPES,)),
        ("slab_normal", np.float64, (MOST_FINGERS, 3)),
        ("slab", np.float64, (MOST_FINGERS, 2)),
        ("near_joint", np.int64),
        ("near_finger", np.int64),
    ],
    align=True,
)
"""Where a hand is, and what is known of its gaps there.

T: pose of the TCP
joints: present values, radians
group: pose of every group at ``joints``
trial: poses of one finger's groups during a step that is being tried
ends: capsule ends of each shape at ``joints``; of a box its centre twice
box_axes: axes of a box as rows
bound: lower bound on each shape's gap to the object, carried along while it moves
still_bound: the same for its gap to the still part of the hand
slab_normal, slab: of the slab that each finger never leaves
near_joint, near_finger: of the gap that ``self_gap_of_finger`` last returned: the joint whose group has it, and the
    finger it is to; the number of fingers if it is to the still part
"""

HandPoses: TypeAlias = Any
"""A record of ``POSES_TYPE``."""


def new_poses() -> npt.NDArray[np.void]:
    """Allocate the poses of a hand: an array of one ``HandPoses``."""
    poses = np.zeros(1, POSES_TYPE)
    for name in ("T", "group", "trial"):
        poses[name][0] = np.eye(4)
    return poses


@njit(cache=True)
def _joint_pose(before: FloatArray, fixed: FloatArray, axis: FloatArray, angle: float, out: FloatArray) -> None:
    """Write ``before @ fixed @ turn(axis, angle)``."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    u = 1.0 - c
    r00, r01, r02 = c + u * x * x, u * x * y - s * z, u * x * z + s * y
    r10, r11, r12 = u * x * y + s * z, c + u * y * y, u * y * z - s * x
    r20, r21, r22 = u * x * z - s * y, u * y * z + s * x, c + u * z * z
    for i in range(3):
        p, q, r = before[i, 0], before[i, 1], before[i, 2]
        a = p * fixed[0, 0] + q * fixed[1, 0] + r * fixed[2, 0]
        b = p * fixed[0, 1] + q * fixed[1, 1] + r * fixed[2, 1]
        d = p * fixed[0, 2] + q * fixed[1, 2] + r * fixed[2, 2]
        out[i, 0] = a * r00 + b * r10 + d * r20
        out[i, 1] = a * r01 + b * r11 + d * r21
        out[i, 2] = a * r02 + b * r12 + d * r22
        out[i, 3] = p * fixed[0, 3] + q * fixed[1, 3] + r * fixed[2, 3] + before[i, 3]


@njit(cache=True)
def _shape_ends(hand: HandArrays, pose: FloatArray, shape: int, out: FloatArray) -> None:
    for which in range(2):
        c = hand.ends[shape, which]
        for k in range(3):
            out[which, k] = pose[k, 0] * c[0] + pose[k, 1] * c[1] + pose[k, 2] * c[2] + pose[k, 3]


@njit(cache=True)
def _place_ends(hand: HandArrays, poses: HandPoses, group: int) -> None:
    for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
        pose = poses.group[group]
        _shape_ends(hand, pose, shape, poses.ends[shape])
        if hand.kind[shape] == BOX:
            for row in range(3):
                for k in range(3):
                    poses.box_axes[shape, row, k] = (
                        pose[k, 0] * hand.box[shape, row, 0]
                        + pose[k, 1] * hand.box[shape, row, 1]
                        + pose[k, 2] * hand.box[shape, row, 2]
                    )


@njit(cache=True)
def place_hand(hand: HandArrays, poses: HandPoses, T: FloatArray) -> None:
    """Place the open hand; nothing is known of its gaps yet."""
    poses.T[:] = T
    poses.joints[:] = hand.start
    F = hand.fingers
    for f in range(F):
        place_finger(hand, poses, f, 0)
    poses.group[F * MOST_JOINTS][:] = T
    _place_ends(hand, poses, F * MOST_JOINTS)
    poses.bound[:] = -np.inf
    poses.still_bound[:] = -np.inf
    for f in range(F):
        offset = 0.0
        for i in range(3):
            n = T[i, 0] * hand.slab_normal[f, 0] + T[i, 1] * hand.slab_normal[f, 1] + T[i, 2] * hand.slab_normal[f, 2]
            poses.slab_normal[f, i] = n
            offset += n * T[i, 3]
        poses.slab[f, 0] = hand.slab[f, 0] + offset
        poses.slab[f, 1] = hand.slab[f, 1] + offset


@njit(cache=True)
def place_finger(hand: HandArrays, poses: HandPoses, f: int, first: int) -> None:
    """Bring a finger's group poses up to date from joint ``first`` on."""
    for j in range(first, hand.joint_count[f]):
        group = f * MOST_JOINTS + j
        before = poses.T[:, :] if j == 0 else poses.group[group - 1, :, :]
        _joint_pose(before, hand.fixed[f, j], hand.axis[f, j], poses.joints[f, j], poses.group[group])
        _place_ends(hand, poses, group)


@njit(cache=True)
def try_joint_value(hand: HandArrays, poses: HandPoses, f: int, moved: int, value: float) -> None:
    """Write the poses that a finger would have with one joint at another value into ``poses.trial``."""
    for j in range(moved, hand.joint_count[f]):
        if j == 0:
            before = poses.T[:, :]
        elif j == moved:
            before = poses.group[f * MOST_JOINTS + j - 1, :, :]
        else:
            before = poses.trial[j - 1, :, :]
        angle = value if j == moved else poses.joints[f, j]
        _joint_pose(before, hand.fixed[f, j], hand.axis[f, j], angle, poses.trial[j])


@njit(cache=True)
def gap_bounds(hand: HandArrays, field: DistanceField, pose: FloatArray, shape: int) -> tuple[float, float]:
    """Return a lower and an upper bound on the gap between a shape and the object."""
    lower, upper = np.inf, np.inf
    for s in range(hand.sphere_start[shape], hand.sphere_start[shape + 1]):
        c = hand.sphere_center[s]
        x = pose[0, 0] * c[0] + pose[0, 1] * c[1] + pose[0, 2] * c[2] + pose[0, 3]
        y = pose[1, 0] * c[0] + pose[1, 1] * c[1] + pose[1, 2] * c[2] + pose[1, 3]
        z = pose[2, 0] * c[0] + pose[2, 1] * c[1] + pose[2, 2] * c[2] + pose[2, 3]
        d = sample(field, x, y, z)
        lower = min(lower, d - field.slack - hand.sphere_radius[s])
        upper = min(upper, d + field.slack)
    return lower, upper


@njit(cache=True)
def shape_motion(hand: HandArrays, shape: int, f: int, step: float) -> float:
    """Bound how far a shape moves when all joints before it in its finger make one step."""
    total = 0.0
    for i in range(hand.joint_count[f]):
        total += abs(hand.speed[f, i]) * hand.reach[shape, i]
    return total * step


@njit(cache=True)
def carry_bounds(hand: HandArrays, poses: HandPoses, f: int, j: int, turn: float) -> None:
    """Lower the bounds on gaps after joint j of finger f has turned by ``turn`` radians."""
    for group in range(f * MOST_JOINTS + j, (f + 1) * MOST_JOINTS):
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            poses.bound[shape] -= abs(turn) * hand.reach[shape, j]
            poses.still_bound[shape] -= abs(turn) * hand.reach[shape, j]


@njit(cache=True)
def _box_excess(a: FloatArray, b: FloatArray, t: float, half: FloatArray) -> float:
    """Return the distance from the point at t on ab to a box about the origin, 0 inside."""
    total = 0.0
    for k in range(3):
        excess = max(abs(a[k] + t * (b[k] - a[k])) - half[k], 0.0)
        total += excess * excess
    return np.sqrt(total)


@njit(cache=True)
def _excess_slope(a: FloatArray, b: FloatArray, t: float, half: FloatArray) -> float:
    """Return half the derivative of the squared ``_box_excess`` by t."""
    total = 0.0
    for k in range(3):
        at = a[k] + t * (b[k] - a[k])
        if at > half[k]:
            total += (at - half[k]) * (b[k] - a[k])
        elif at < -half[k]:
            total += (at + half[k]) * (b[k] - a[k])
    return total


@njit(cache=True)
def _segment_box(hand: HandArrays, poses: HandPoses, ends: FloatArray, other: int, enough: float) -> float:
    """Return the distance between a segment and a box of the hand.

    Beyond ``enough`` it may be a lower bound, itself beyond ``enough``.
    """
    a, b, box = poses.scratch[0], poses.scratch[1], hand.box[other]
    for row in range(3):
        a[row] = b[row] = 0.0
        for k in range(3):
            a[row] += poses.box_axes[other, row, k] * (ends[0, k] - poses.ends[other, 0, k])
            b[row] += poses.box_axes[other, row, k] * (ends[1, k] - poses.ends[other, 0, k])
    apart2 = 0.0
    for k in range(3):
        apart = max(min(a[k], b[k]) - box[3, k], -max(a[k], b[k]) - box[3, k], 0.0)
        apart2 += apart * apart
    if apart2 > enough * enough:
        return np.sqrt(apart2)
    # The slope of the squared distance grows along the segment: find where it changes sign.
    low, high = 0.0, 1.0
    low_slope, high_slope = _excess_slope(a, b, 0.0, box[3]), _excess_slope(a, b, 1.0, box[3])
    if low_slope >= 0.0:
        return _box_excess(a, b, 0.0, box[3])
    if high_slope <= 0.0:
        return _box_excess(a, b, 1.0, box[3])
    for _ in range(32):
        t = low - low_slope * (high - low) / (high_slope - low_slope)
        slope = _excess_slope(a, b, t, box[3])
        if abs(slope) < 1e-13 or high - low < 1e-9:
            break
        if slope < 0.0:
            low, low_slope, high_slope = t, slope, 0.5 * high_slope
        else:
            high, high_slope, low_slope = t, slope, 0.5 * low_slope
    return _box_excess(a, b, t, box[3])


@njit(cache=True)
def _self_gap(hand: HandArrays, poses: HandPoses, shape: int, ends: FloatArray, other: int, enough: float) -> float:
    """Return the gap between a shape (no box) with its ends at ``ends`` and another one of the hand.

    Beyond ``enough`` it may be a lower bound from bounding spheres instead, itself beyond ``enough``.
    """
    apart2 = 0.0
    for k in range(3):
        apart = ends[0, k] + ends[1, k] - poses.ends[other, 0, k] - poses.ends[other, 1, k]
        apart2 += 0.25 * apart * apart
    needed = enough + hand.ball[shape] + hand.ball[other]
    if apart2 > needed * needed:
        return np.sqrt(apart2) - hand.ball[shape] - hand.ball[other]
    if hand.kind[other] == BOX:
        return _segment_box(hand, poses, ends, other, enough + hand.radius[shape]) - hand.radius[shape]
    apart = segment_segment(ends[0], ends[1], poses.ends[other, 0], poses.ends[other, 1])
    return apart - hand.radius[shape] - hand.radius[other]


@njit(cache=True)
def _slab_gap(hand: HandArrays, poses: HandPoses, shape: int, ends: FloatArray, g: int) -> float:
    """Return the gap between a shape and the slab of finger g; negative if they overlap."""
    first = last = 0.0
    for k in range(3):
        first += poses.slab_normal[g, k] * ends[0, k]
        last += poses.slab_normal[g, k] * ends[1, k]
    above, below = min(first, last) - poses.slab[g, 1], poses.slab[g, 0] - max(first, last)
    return max(above, below) - hand.radius[shape]


@njit(cache=True)
def _gap_to_fingers(hand: HandArrays, poses: HandPoses, shape: int, ends: FloatArray) -> tuple[float, int]:
    """Return the smallest gap between a shape with its ends at ``ends`` and the other fingers, and which of them."""
    smallest, nearest, finger, clear = np.inf, -1, -1, False
    for i in range(hand.pair_start[shape], hand.pair_start[shape + 1]):
        other = hand.pair_other[i]
        g = hand.shape_group[other] // MOST_JOINTS
        if g == hand.fingers:
            break
        if g != finger:
            finger, apart = g, _slab_gap(hand, poses, shape, ends, g)
            clear = apart > SELF_GAP_OF_INTEREST
            if clear and apart < smallest:
                smallest, nearest = apart, g
        if not clear:
            apart = _self_gap(hand, poses, shape, ends, other, min(smallest, SELF_GAP_OF_INTEREST))
            if apart < smallest:
                smallest, nearest = apart, g
    return smallest, nearest


@njit(cache=True)
def _gap_to_still_part(hand: HandArrays, poses: HandPoses, shape: int, ends: FloatArray, motion: float) -> float:
    """Return the gap between a shape and the still part of the hand, or a bound beyond ``SELF_GAP_OF_INTEREST``.

    Args:
        hand: the hand.
        poses: where it is.
        shape: the shape.
        ends: where the shape's ends are.
        motion: how far the shape may have moved from its present place to there.
    """
    if poses.still_bound[shape] - motion > SELF_GAP_OF_INTEREST:
        return poses.still_bound[shape] - motion
    smallest = STILL_GAP_OF_INTEREST
    for i in range(hand.pair_start[shape], hand.pair_start[shape + 1]):
        other = hand.pair_other[i]
        if hand.shape_group[other] // MOST_JOINTS == hand.fingers:
            smallest = min(smallest, _self_gap(hand, poses, shape, ends, other, smallest))
    poses.still_bound[shape] = max(poses.still_bound[shape], smallest - motion)
    return smallest


@njit(cache=True)
def self_gap_of_finger(hand: HandArrays, poses: HandPoses, f: int, first: int, turn: float) -> float:
    """Return the smallest gap between a finger, from a joint on, and the rest of the hand.

    Args:
        hand: the hand.
        poses: where it is.
        f: the finger.
        first: joint from which on its links count.
        turn: if not 0, the finger stands at ``poses.trial``, where joint ``first`` has turned by so many radians.

    Returns:
        The gap, metres; beyond ``SELF_GAP_OF_INTEREST`` a lower bound.
    """
    smallest = np.inf
    ends = poses.scratch[2:4]
    for j in range(first, hand.joint_count[f]):
        group = f * MOST_JOINTS + j
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            if turn != 0.0:
                _shape_ends(hand, poses.trial[j], shape, ends)
            else:
                ends[:] = poses.ends[shape]
            gap, other = _gap_to_fingers(hand, poses, shape, ends)
            still = _gap_to_still_part(hand, poses, shape, ends, abs(turn) * hand.reach[shape, first])
            if still < gap:
                gap, other = still, hand.fingers
            if gap < smallest:
                smallest, poses.near_joint, poses.near_finger = gap, j, other
    return smallest


def exempt_touching_pairs(hand: HandArrays) -> None:
    """Exempt pairs of links that touch in the open hand from the test of the hand against itself."""
    poses = new_poses()[0]
    place_hand(hand, poses, np.eye(4))
    pairs = {(int(shape), int(other)) for shape, other in pairs_nearer(hand, poses, FREE_AT_START)[0]}
    drop_pairs(hand, pairs | {(other, shape) for shape, other in pairs} | never_meeting_pairs(hand))


@njit(cache=True)
def open_hand_gap(hand: HandArrays, poses: HandPoses, shape: int, other: int) -> float:
    """Return the gap between two shapes, the first no box, where the hand now is."""
    return _self_gap(hand, poses, shape, poses.ends[shape], other, np.inf)


@njit(cache=True)
def pairs_nearer(hand: HandArrays, poses: HandPoses, gap: float) -> tuple[IntArray, FloatArray]:
    """Return the tested pairs of shapes nearer than ``gap`` metres to each other, shape (n, 2), and their gaps (n,)."""
    tested = hand.pair_start[hand.shapes]
    pairs, gaps = np.empty((tested, 2), dtype=np.int64), np.empty(tested)
    count = 0
    for shape in range(hand.shapes):
        for i in range(hand.pair_start[shape], hand.pair_start[shape + 1]):
            gaps[count] = open_hand_gap(hand, poses, shape, hand.pair_other[i])
            if gaps[count] < gap:
                pairs[count, 0], pairs[count, 1] = shape, hand.pair_other[i]
                count += 1
    return pairs[:count], gaps[:count]
