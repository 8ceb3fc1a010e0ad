"""The closing of a hand on an object, compiled: when does which joint stop?

Rule (thesis, section 6; thesis_facts A4 in the words of Simox): every finger closes all its joints by a small
step a round, from the palm outwards. A joint whose step would bring a link of its finger into the object or
into another link goes as far as it can (here to a gap below ``gap_tolerance``, by root search) and stops; its
outer joints go on. A finger is done when none of its joints can move. When all are done, every finger is
tried once more, until a whole pass moves nothing.

The loop asks for an exact distance only when the distance field cannot decide. It then returns the shape in
question and its pose; the caller puts the answer into the notebook and calls again. A step is replayed from
its start with the answers known so far, so the loop itself holds no half-made decisions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField, sample
from mebo_grasp.grasping.hand_arrays import BOX, MOST_JOINTS, HandArrays

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DONE = -1
MOST_NOTES = 256
MOST_ROUNDS = 4000
MOST_PASSES = 12
MOST_SEARCH_STEPS = 24
SELF_GAP_OF_INTEREST = 0.002
"""Gaps between links beyond this need not be exact during a step, metres."""
SMALLEST_MOVE = 2e-4
"""A joint that can move by less than this share of a step counts as blocked (times the step, radians)."""

FREE, BLOCKED, ASK = 0, 1, 2
CURSOR_FINGER, CURSOR_JOINT, CURSOR_MOVED, PASS_MOVED, ROUND, PASS, NOTES, ASKED, PHASE = range(9)
STARTING, CLOSING = 0, 1


class ClosingRule(NamedTuple):
    """Numbers of the closing rule.

    Attributes:
        step: largest step of a joint, radians.
        gap_tolerance: gap at which a link counts as touching, metres.
        whole_finger: whether a touching link stops every joint of its finger.
    """

    step: float
    gap_tolerance: float
    whole_finger: bool


class ClosingState(NamedTuple):
    """What changes while a hand closes. T is the pose of the TCP in the object's frame.

    Attributes:
        T: (4, 4)
        joints: (F, J) present values, radians.
        group_pose: (G, 4, 4) pose of every group in the object's frame at ``joints``.
        trial_pose: (J, 4, 4) scratch: poses of one finger during a step.
        cursor: integers named CURSOR_... above.
        done: (F,) whether a finger is done in this pass.
        credit: (F,) rounds that a finger can close unseen.
        stamp: (F + 1,) number of moves of each finger, and of all.
        blocked_at: (F, J, 2) stamps at which a joint was found blocked; by the object (own), by any link (all).
        gap: (P,) exact gap of a shape at the present posture, where known.
        gap_stamp: (P,) stamp of its finger at which ``gap`` was measured; -1 never.
        note_shape, note_step, note_gap: (N,) answers within the present step.
        pressing: (J, P) whether the last step tried of joint j would have brought a shape into the object.
        halted: (F,) whether a finger is stopped for good (rule ``whole_finger``).
    """

    T: FloatArray
    joints: FloatArray
    group_pose: FloatArray
    trial_pose: FloatArray
    cursor: IntArray
    done: npt.NDArray[np.bool_]
    credit: IntArray
    stamp: IntArray
    blocked_at: IntArray
    gap: FloatArray
    gap_stamp: IntArray
    note_shape: IntArray
    note_step: FloatArray
    note_gap: FloatArray
    pressing: npt.NDArray[np.bool_]
    halted: npt.NDArray[np.bool_]


def new_state(hand: HandArrays) -> ClosingState:
    """Allocate the state for a hand; ``begin`` sets it up for a pose."""
    F, J = hand.start.shape
    P = len(hand.shape_group)
    return ClosingState(
        np.eye(4), np.zeros((F, J)), np.tile(np.eye(4), (F * J + 1, 1, 1)), np.tile(np.eye(4), (J, 1, 1)),
        np.zeros(9, np.int64), np.zeros(F, np.bool_), np.zeros(F, np.int64), np.zeros(F + 1, np.int64),
        np.zeros((F, J, 2), np.int64), np.zeros(P), np.zeros(P, np.int64), np.zeros(MOST_NOTES, np.int64),
        np.zeros(MOST_NOTES), np.zeros(MOST_NOTES), np.zeros((J, P), np.bool_), np.zeros(F, np.bool_),
    )


@njit(cache=True)
def _multiply(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        for j in range(4):
            total = A[i, 3] if j == 3 else 0.0
            for k in range(3):
                total += A[i, k] * B[k, j]
            out[i, j] = total


@njit(cache=True)
def _joint_pose(before: FloatArray, fixed: FloatArray, axis: FloatArray, angle: float, out: FloatArray) -> None:
    """Write ``before @ fixed @ turn(axis, angle)``."""
    base = np.empty((4, 4))
    _multiply(before, fixed, base)
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    u = 1.0 - c
    r00, r01, r02 = c + u * x * x, u * x * y - s * z, u * x * z + s * y
    r10, r11, r12 = u * x * y + s * z, c + u * y * y, u * y * z - s * x
    r20, r21, r22 = u * x * z - s * y, u * y * z + s * x, c + u * z * z
    for i in range(3):
        a, b, d = base[i, 0], base[i, 1], base[i, 2]
        out[i, 0] = a * r00 + b * r10 + d * r20
        out[i, 1] = a * r01 + b * r11 + d * r21
        out[i, 2] = a * r02 + b * r12 + d * r22
        out[i, 3] = base[i, 3]


@njit(cache=True)
def _place_finger(hand: HandArrays, state: ClosingState, f: int, first: int) -> None:
    """Bring a finger's group poses up to date from joint ``first`` on."""
    for j in range(first, hand.joint_count[f]):
        before = state.T if j == 0 else state.group_pose[f * MOST_JOINTS + j - 1]
        _joint_pose(before, hand.fixed[f, j], hand.axis[f, j], state.joints[f, j], state.group_pose[f * MOST_JOINTS + j])


@njit(cache=True)
def _try_finger(hand: HandArrays, state: ClosingState, f: int, moved: int, value: float) -> None:
    """Write the poses that a finger would have with one joint at another value into the scratch poses."""
    for j in range(moved, hand.joint_count[f]):
        if j == 0:
            before = state.T
        elif j == moved:
            before = state.group_pose[f * MOST_JOINTS + j - 1]
        else:
            before = state.trial_pose[j - 1]
        angle = value if j == moved else state.joints[f, j]
        _joint_pose(before, hand.fixed[f, j], hand.axis[f, j], angle, state.trial_pose[j])


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
def begin(hand: HandArrays, state: ClosingState, T: FloatArray) -> None:
    """Place the open hand."""
    state.T[:] = T
    state.joints[:] = hand.start
    F = hand.joint_count.shape[0]
    for f in range(F):
        _place_finger(hand, state, f, 0)
    state.group_pose[F * MOST_JOINTS] = T
    state.cursor[:] = 0
    state.done[:] = False
    state.credit[:] = 0
    state.stamp[:] = 0
    state.blocked_at[:] = -1
    state.gap_stamp[:] = -1
    state.pressing[:] = False
    state.halted[:] = False


@njit(cache=True)
def starts_in_collision(
    hand: HandArrays, field: DistanceField, state: ClosingState, asked: npt.NDArray[np.bool_]
) -> bool:
    """Mark the shapes that need an exact query; True if the field alone proves a collision."""
    for shape in range(hand.shape_group.shape[0]):
        lower, upper = gap_bounds(hand, field, state.group_pose[hand.shape_group[shape]], shape)
        if upper < 0.0:
            return True
        asked[shape] = lower <= 0.0
    return False


@njit(cache=True)
def _segment_segment(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> float:
    """Return the distance between segments pq and rs (Ericson, 2005, section 5.1.9)."""
    a = e = b = c = f = 0.0
    for k in range(3):
        d1, d2, w = q[k] - p[k], s[k] - r[k], p[k] - r[k]
        a += d1 * d1
        e += d2 * d2
        b += d1 * d2
        c += d1 * w
        f += d2 * w
    if a <= 1e-18:
        t = 0.0
        u = min(max(f / e, 0.0), 1.0) if e > 1e-18 else 0.0
    elif e <= 1e-18:
        u = 0.0
        t = min(max(-c / a, 0.0), 1.0)
    else:
        denominator = a * e - b * b
        t = min(max((b * f - c * e) / denominator, 0.0), 1.0) if denominator > 1e-18 else 0.0
        u = (b * t + f) / e
        if u < 0.0:
            u = 0.0
            t = min(max(-c / a, 0.0), 1.0)
        elif u > 1.0:
            u = 1.0
            t = min(max((b - c) / a, 0.0), 1.0)
    total = 0.0
    for k in range(3):
        total += (p[k] + t * (q[k] - p[k]) - r[k] - u * (s[k] - r[k])) ** 2
    return np.sqrt(total)


@njit(cache=True)
def _point_box(p: FloatArray, box: FloatArray, center: FloatArray, pose: FloatArray) -> float:
    """Return the distance from a point to a box, 0 inside; ``box`` holds its axes as rows and its half sides."""
    total = 0.0
    for row in range(3):
        coordinate = 0.0
        for k in range(3):
            axis = 0.0
            for m in range(3):
                axis += pose[k, m] * box[row, m]
            middle = pose[k, 3]
            for m in range(3):
                middle += pose[k, m] * center[m]
            coordinate += axis * (p[k] - middle)
        excess = max(abs(coordinate) - box[3, row], 0.0)
        total += excess * excess
    return np.sqrt(total)


@njit(cache=True)
def _end(hand: HandArrays, pose: FloatArray, shape: int, which: int, out: FloatArray) -> None:
    c = hand.ends[shape, which]
    for k in range(3):
        out[k] = pose[k, 0] * c[0] + pose[k, 1] * c[1] + pose[k, 2] * c[2] + pose[k, 3]


@njit(cache=True)
def _segment_box(p: FloatArray, q: FloatArray, box: FloatArray, center: FloatArray, pose: FloatArray) -> float:
    """Return the distance between a segment and a box: a convex function of the place on the segment."""
    low, high = 0.0, 1.0
    point = np.empty(3)
    best = np.inf
    for _ in range(24):
        third = (high - low) / 3.0
        left, right = low + third, high - third
        for k in range(3):
            point[k] = p[k] + left * (q[k] - p[k])
        at_left = _point_box(point, box, center, pose)
        for k in range(3):
            point[k] = p[k] + right * (q[k] - p[k])
        at_right = _point_box(point, box, center, pose)
        best = min(best, at_left, at_right)
        if at_left < at_right:
            high = right
        else:
            low = left
    return best


@njit(cache=True)
def _centre_distance(hand: HandArrays, p: FloatArray, q: FloatArray, other: int, pose: FloatArray) -> float:
    """Bound the distance between a segment and another shape from below by their bounding spheres."""
    half2, total, other_half2 = 0.0, 0.0, 0.0
    for k in range(3):
        middle = 0.0
        for m in range(3):
            middle += pose[k, m] * 0.5 * (hand.ends[other, 0, m] + hand.ends[other, 1, m])
        half2 += (0.5 * (q[k] - p[k])) ** 2
        total += (0.5 * (p[k] + q[k]) - middle - pose[k, 3]) ** 2
        other_half2 += hand.box[other, 3, k] ** 2 + (0.5 * (hand.ends[other, 1, k] - hand.ends[other, 0, k])) ** 2
    return np.sqrt(total) - np.sqrt(half2) - np.sqrt(other_half2) - hand.radius[other]


@njit(cache=True)
def self_gap(
    hand: HandArrays, shape: int, pose: FloatArray, other: int, other_pose: FloatArray, enough: float
) -> float:
    """Return the gap between two shapes of the hand, of which the first is no box.

    A gap beyond ``enough`` may be given by a smaller lower bound, itself beyond ``enough``.
    """
    p, q = np.empty(3), np.empty(3)
    _end(hand, pose, shape, 0, p)
    _end(hand, pose, shape, 1, q)
    bound = _centre_distance(hand, p, q, other, other_pose) - hand.radius[shape]
    if bound > enough:
        return bound
    if hand.kind[other] == BOX:
        return _segment_box(p, q, hand.box[other], hand.ends[other, 0], other_pose) - hand.radius[shape]
    r, s = np.empty(3), np.empty(3)
    _end(hand, other_pose, other, 0, r)
    _end(hand, other_pose, other, 1, s)
    return _segment_segment(p, q, r, s) - hand.radius[shape] - hand.radius[other]


@njit(cache=True)
def _self_gap_of_finger(hand: HandArrays, state: ClosingState, f: int, first: int) -> float:
    """Return the smallest gap between a finger at its scratch poses, from a joint on, and the rest of the hand."""
    smallest = np.inf
    for j in range(first, hand.joint_count[f]):
        group = f * MOST_JOINTS + j
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            for other in range(hand.pairs.shape[0]):
                if hand.pairs[shape, other]:
                    gap = self_gap(
                        hand, shape, state.trial_pose[j], other, state.group_pose[hand.shape_group[other]],
                        smallest if smallest > 0.0 and smallest < np.inf else SELF_GAP_OF_INTEREST,
                    )
                    smallest = min(smallest, gap)
    return smallest


@njit(cache=True)
def _known_gap(state: ClosingState, shape: int, step: float) -> float:
    for i in range(state.cursor[NOTES]):
        if state.note_shape[i] == shape and state.note_step[i] == step:
            return state.note_gap[i]
    return np.nan


@njit(cache=True)
def _gap_after(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, state: ClosingState, f: int, j: int, share: float,
    signed_step: float,
) -> tuple[float, float]:
    """Return the smallest gaps to the object and to the hand after a share of a step; NaN asks for a query."""
    _try_finger(hand, state, f, j, state.joints[f, j] + share * signed_step)
    to_object = np.inf
    for i in range(j, hand.joint_count[f]):
        group = f * MOST_JOINTS + i
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            if share == 1.0:
                state.pressing[j, shape] = False
            lower, _ = gap_bounds(hand, field, state.trial_pose[i], shape)
            if lower > rule.gap_tolerance:
                continue
            gap = _known_gap(state, shape, share)
            if np.isnan(gap) and share == 0.0 and state.gap_stamp[shape] == state.stamp[f]:
                gap = state.gap[shape]
            if np.isnan(gap):
                state.cursor[ASKED] = shape
                notes = state.cursor[NOTES]
                state.note_shape[notes] = shape
                state.note_step[notes] = share
                return np.nan, np.nan
            if share == 1.0:
                state.pressing[j, shape] = gap <= 0.0
            elif share == 0.0:
                state.gap[shape] = gap
                state.gap_stamp[shape] = state.stamp[f]
            to_object = min(to_object, gap)
    return to_object, _self_gap_of_finger(hand, state, f, j)


@njit(cache=True)
def _try_joint(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, state: ClosingState, f: int, j: int,
) -> tuple[int, float, bool]:
    """Find how far a joint can go in one step: outcome, share of the step, and whether the object blocks it."""
    signed_step = rule.step * hand.speed[f, j]
    to_object, to_hand = _gap_after(hand, field, rule, state, f, j, 1.0, signed_step)
    if np.isnan(to_object):
        return ASK, 0.0, False
    if to_object > 0.0 and to_hand > 0.0:
        return FREE, 1.0, False
    by_object = to_object <= 0.0
    low, high, high_gap = 0.0, 1.0, min(to_object, to_hand)
    to_object, to_hand = _gap_after(hand, field, rule, state, f, j, 0.0, signed_step)
    if np.isnan(to_object):
        return ASK, 0.0, False
    low_gap = min(to_object, to_hand)
    target = 0.5 * rule.gap_tolerance
    for _ in range(MOST_SEARCH_STEPS):
        if low_gap <= rule.gap_tolerance:
            break
        share = low + (high - low) * (low_gap - target) / (low_gap - high_gap)
        inset = 0.02 * (high - low)
        share = min(max(share, low + inset), high - inset)
        to_object, to_hand = _gap_after(hand, field, rule, state, f, j, share, signed_step)
        if np.isnan(to_object):
            return ASK, 0.0, False
        gap = min(to_object, to_hand)
        if gap > 0.0:
            low, low_gap = share, gap
        else:
            high, high_gap = share, gap
    return BLOCKED, low, by_object


@njit(cache=True)
def _free_rounds(hand: HandArrays, field: DistanceField, rule: ClosingRule, state: ClosingState, f: int) -> int:
    """Bound from below how many rounds a finger can close without touching anything."""
    rounds = 1e9
    for j in range(hand.joint_count[f]):
        group = f * MOST_JOINTS + j
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            pose = state.group_pose[group]
            lower, _ = gap_bounds(hand, field, pose, shape)
            motion = _motion(hand, rule, shape, f, j)
            rounds = min(rounds, lower / motion)
            if rounds < 1.0:
                return 0
            for other in range(hand.pairs.shape[0]):
                if hand.pairs[shape, other]:
                    other_group = hand.shape_group[other]
                    g = other_group // MOST_JOINTS
                    both = motion
                    if g < hand.joint_count.shape[0]:
                        both += _motion(hand, rule, other, g, other_group - g * MOST_JOINTS)
                    gap = self_gap(hand, shape, pose, other, state.group_pose[other_group], rounds * both)
                    rounds = min(rounds, gap / both)
                    if rounds < 1.0:
                        return 0
    return int(rounds)


@njit(cache=True)
def _motion(hand: HandArrays, rule: ClosingRule, shape: int, f: int, j: int) -> float:
    """Bound how far a shape moves in one round."""
    total = 0.0
    for i in range(j + 1):
        total += abs(hand.speed[f, i]) * hand.reach[shape, i]
    return total * rule.step


@njit(cache=True)
def _at_limit(hand: HandArrays, rule: ClosingRule, state: ClosingState, f: int, j: int) -> bool:
    value = state.joints[f, j] + rule.step * hand.speed[f, j]
    return value > hand.upper[f, j] + 1e-12 or value < hand.lower[f, j] - 1e-12


@njit(cache=True)
def _moved(state: ClosingState, f: int) -> None:
    state.stamp[f] += 1
    state.stamp[state.stamp.shape[0] - 1] += 1


@njit(cache=True)
def _still_blocked(state: ClosingState, f: int, j: int) -> bool:
    last = state.stamp.shape[0] - 1
    return state.blocked_at[f, j, 0] == state.stamp[f] or state.blocked_at[f, j, 1] == state.stamp[last]


@njit(cache=True)
def _glide(hand: HandArrays, rule: ClosingRule, state: ClosingState, f: int) -> bool:
    """Close a finger by one round that is known to be free; return whether anything moved."""
    moved = False
    for j in range(hand.joint_count[f]):
        if not _at_limit(hand, rule, state, f, j):
            state.joints[f, j] += rule.step * hand.speed[f, j]
            moved = True
    if moved:
        _place_finger(hand, state, f, 0)
        _moved(state, f)
    return moved


@njit(cache=True)
def _release(hand: HandArrays, state: ClosingState, f: int, j: int) -> None:
    """Forget what a joint pressed on before it reached its limit."""
    for group in range(f * MOST_JOINTS, (f + 1) * MOST_JOINTS):
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            state.pressing[j, shape] = False


@njit(cache=True)
def _step_joint(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, state: ClosingState, f: int, j: int,
) -> int:
    """Try one step of one joint: FREE if it moved, BLOCKED if not, ASK if a distance is missing."""
    if state.halted[f]:
        return BLOCKED
    if _at_limit(hand, rule, state, f, j):
        _release(hand, state, f, j)
        return BLOCKED
    if _still_blocked(state, f, j):
        return BLOCKED
    outcome, share, by_object = _try_joint(hand, field, rule, state, f, j)
    if outcome == ASK:
        return ASK
    state.cursor[NOTES] = 0
    moved = share > SMALLEST_MOVE
    if moved:
        state.joints[f, j] += share * rule.step * hand.speed[f, j]
        _place_finger(hand, state, f, j)
        _moved(state, f)
    if outcome == BLOCKED:
        which = 0 if by_object else 1
        state.halted[f] = rule.whole_finger and by_object
        state.blocked_at[f, j, which] = state.stamp[f] if by_object else state.stamp[state.stamp.shape[0] - 1]
    return FREE if moved else BLOCKED


@njit(cache=True)
def _finish_finger_round(state: ClosingState, f: int) -> None:
    if state.cursor[CURSOR_MOVED] == 0:
        state.done[f] = True
    else:
        state.cursor[PASS_MOVED] = 1
    state.cursor[CURSOR_MOVED] = 0
    state.cursor[CURSOR_JOINT] = 0
    state.cursor[CURSOR_FINGER] = f + 1


@njit(cache=True)
def _next_round(state: ClosingState) -> bool:
    """Go on to the next round or pass; False when the hand is closed."""
    state.cursor[CURSOR_FINGER] = 0
    state.cursor[ROUND] += 1
    if state.cursor[ROUND] >= MOST_ROUNDS:
        return False
    if not np.all(state.done):
        return True
    state.cursor[PASS] += 1
    if state.cursor[PASS_MOVED] == 0 or state.cursor[PASS] >= MOST_PASSES:
        return False
    state.cursor[PASS_MOVED] = 0
    state.done[:] = False
    state.credit[:] = 0
    return True


@njit(cache=True)
def advance(hand: HandArrays, field: DistanceField, rule: ClosingRule, state: ClosingState) -> int:
    """Close the hand until it stops (``DONE``) or needs the exact gap of the shape returned.

    The pose of that shape's group is ``state.trial_pose[joint]`` with the joint from its group. The answer goes
    into ``note_gap`` at position ``cursor[NOTES]``, which is then increased by one.
    """
    F = hand.joint_count.shape[0]
    while True:
        f = state.cursor[CURSOR_FINGER]
        if f >= F:
            if not _next_round(state):
                return DONE
            continue
        if state.done[f]:
            state.cursor[CURSOR_FINGER] = f + 1
            continue
        if state.cursor[CURSOR_JOINT] == 0 and state.cursor[NOTES] == 0 and state.cursor[CURSOR_MOVED] == 0:
            if state.credit[f] == 0:
                state.credit[f] = _free_rounds(hand, field, rule, state, f)
            if state.credit[f] > 0:
                state.credit[f] -= 1
                state.cursor[CURSOR_MOVED] = 1 if _glide(hand, rule, state, f) else 0
                _finish_finger_round(state, f)
                continue
        j = state.cursor[CURSOR_JOINT]
        while j < hand.joint_count[f]:
            outcome = _step_joint(hand, field, rule, state, f, j)
            if outcome == ASK:
                return state.cursor[ASKED]
            if outcome == FREE:
                state.cursor[CURSOR_MOVED] = 1
            j += 1
            state.cursor[CURSOR_JOINT] = j
        _finish_finger_round(state, f)


@njit(cache=True)
def drop_touching_pairs(hand: HandArrays, state: ClosingState, smallest_gap: float) -> int:
    """Exempt pairs of links that touch in the open hand from the test of the hand against itself."""
    dropped = 0
    begin(hand, state, np.eye(4))
    n = hand.pairs.shape[0]
    for shape in range(n):
        for other in range(n):
            if hand.pairs[shape, other]:
                pose, other_pose = state.group_pose[hand.shape_group[shape]], state.group_pose[hand.shape_group[other]]
                if self_gap(hand, shape, pose, other, other_pose, np.inf) < smallest_gap:
                    hand.pairs[shape, other] = False
                    dropped += 1
    return dropped
