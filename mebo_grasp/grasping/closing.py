"""The closing of a hand on an object, compiled: when does which joint stop?

Rule (thesis, section 6; the end-effector of Simox): every finger closes all its joints by a small step a
round, from the palm outwards. A joint whose step would bring a link of its finger into the object or into
another link goes as far as it can (here to a gap below ``gap_tolerance``, by root search) and stops; its
outer joints go on. A finger is done when none of its joints can move. When all are done, every finger is
tried once more, until a whole pass moves nothing.

The loop asks for an exact distance only when bounds cannot decide. It then returns the shape in question; the
caller puts the answer into the notebook (``answer``) and calls again. A step is replayed from its start with
the answers known so far, so that the loop itself holds no half-made decisions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.hand_arrays import MOST_JOINTS, HandArrays
from mebo_grasp.grasping.hand_motion import (
    HandPoses,
    carry_bounds,
    gap_bounds,
    place_finger,
    self_gap_of_finger,
    shape_motion,
    try_joint_value,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DONE = -1
MOST_NOTES = 512
MOST_ROUNDS = 4000
MOST_PASSES = 12
MOST_SEARCH_STEPS = 24
SMALLEST_MOVE = 2e-4
"""A joint that can move by less than this share of a step counts as blocked."""

FREE, BLOCKED, ASK = 0, 1, 2
OTHER_LINK = MOST_JOINTS
FINGER, JOINT, MOVED, PASS_MOVED, ROUND, PASS, NOTES, ASKED = range(8)
"""Places in ``ClosingState.cursor``."""


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
    """What changes while a hand closes, besides its poses.

    Attributes:
        cursor: integers, see ``FINGER`` and the names after it.
        done: (F,) whether a finger is done in this pass.
        halted: (F,) whether a finger is stopped for good (rule ``whole_finger``).
        credit: (F,) rounds that a finger can close clear of the object.
        stamp: (F, J) number of moves of the group of joint j, which joints up to j move.
        moves: (1,) number of moves of all.
        blocked_by: (F, J) which joint's group holds a joint up by touching the object; -1 none, OTHER_LINK another link.
        blocked_at: (F, J) stamp of that group (or ``moves``) when it did.
        gap, gap_stamp: (P,) exact gap of a shape, and the stamp of its group then; -1 never.
        note_shape, note_share, note_gap: (N,) answers within the present step.
        hit: (P,) whether the full step now tried brings a shape into the object.
        nearest: (1,) joint of the innermost group that touches in the posture last tried; -1 none.
    """

    cursor: IntArray
    done: npt.NDArray[np.bool_]
    halted: npt.NDArray[np.bool_]
    credit: IntArray
    stamp: IntArray
    moves: IntArray
    blocked_by: IntArray
    blocked_at: IntArray
    gap: FloatArray
    gap_stamp: IntArray
    note_shape: IntArray
    note_share: FloatArray
    note_gap: FloatArray
    hit: npt.NDArray[np.bool_]
    nearest: IntArray


def new_state(hand: HandArrays) -> ClosingState:
    """Allocate the state for a hand."""
    F, J = hand.start.shape
    P = len(hand.shape_group)
    return ClosingState(
        np.zeros(8, np.int64), np.zeros(F, np.bool_), np.zeros(F, np.bool_), np.zeros(F, np.int64),
        np.zeros((F, J), np.int64), np.zeros(1, np.int64), np.zeros((F, J), np.int64), np.zeros((F, J), np.int64),
        np.zeros(P), np.zeros(P, np.int64), np.zeros(MOST_NOTES, np.int64), np.zeros(MOST_NOTES),
        np.zeros(MOST_NOTES), np.zeros(P, np.bool_), np.zeros(1, np.int64),
    )


@njit(cache=True)
def begin(state: ClosingState) -> None:
    """Forget the trial before."""
    state.cursor[:] = 0
    state.done[:] = False
    state.halted[:] = False
    state.credit[:] = 0
    state.stamp[:] = 0
    state.moves[:] = 0
    state.blocked_by[:] = -1
    state.gap_stamp[:] = -1


@njit(cache=True)
def answer(state: ClosingState, gap: float) -> None:
    """Note the exact gap that ``advance`` asked for."""
    state.note_gap[state.cursor[NOTES]] = gap
    state.cursor[NOTES] += 1


@njit(cache=True)
def _known_gap(state: ClosingState, stamp: int, shape: int, share: float) -> float:
    if share == 0.0 and state.gap_stamp[shape] == stamp:
        return state.gap[shape]
    for i in range(state.cursor[NOTES]):
        if state.note_shape[i] == shape and state.note_share[i] == share:
            return state.note_gap[i]
    return np.nan


@njit(cache=True)
def _gap_after(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, state: ClosingState,
    f: int, j: int, share: float,
) -> tuple[float, float]:
    """Return the smallest gaps to the object and to the hand after a share of a step; NaN asks for a query.

    Gaps beyond the tolerance may be lower bounds.
    """
    turn = share * rule.step * hand.speed[f, j]
    try_joint_value(hand, poses, f, j, poses.joints[f, j] + turn)
    to_object = np.inf
    state.nearest[0] = -1
    for i in range(j, hand.joint_count[f]):
        group = f * MOST_JOINTS + i
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            if share == 1.0:
                state.hit[shape] = False
            gap = _known_gap(state, state.stamp[f, i], shape, share)
            if np.isnan(gap):
                lower = poses.bound[shape] - abs(turn) * hand.reach[shape, j]
                if lower <= rule.gap_tolerance:
                    lower = max(lower, gap_bounds(hand, field, poses.trial[i], shape)[0])
                if lower > rule.gap_tolerance:
                    to_object = min(to_object, lower)
                    continue
                state.cursor[ASKED] = shape
                state.note_shape[state.cursor[NOTES]] = shape
                state.note_share[state.cursor[NOTES]] = share
                return np.nan, np.nan
            if share == 1.0:
                state.hit[shape] = gap <= 0.0
            if 0.0 < gap <= rule.gap_tolerance and state.hit[shape] and state.nearest[0] < 0:
                state.nearest[0] = i
            to_object = min(to_object, gap)
    return to_object, self_gap_of_finger(hand, poses, f, j, True)


@njit(cache=True)
def _try_joint(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int, j: int
) -> tuple[int, float, int]:
    """Find how far a joint can go in one step.

    Returns:
        The outcome, the share of the step, and what holds the joint up: the joint of a touching group, OTHER_LINK for
        another link, -1 if that is not known.
    """
    to_object, to_hand = _gap_after(hand, field, rule, poses, state, f, j, 1.0)
    if np.isnan(to_object):
        return ASK, 0.0, -1
    if to_object > 0.0 and to_hand > 0.0:
        return FREE, 1.0, -1
    by_hand = to_object > 0.0
    low, high, high_weight = 0.0, 1.0, min(to_object, to_hand)
    to_object, to_hand = _gap_after(hand, field, rule, poses, state, f, j, 0.0)
    if np.isnan(to_object):
        return ASK, 0.0, -1
    low_gap = min(to_object, to_hand)
    low_weight, holding = low_gap, state.nearest[0]
    for _ in range(MOST_SEARCH_STEPS):
        if low_gap <= rule.gap_tolerance:
            break
        # Regula falsi towards half the tolerance, kept away from the ends of the bracket; an end that stays
        # put loses weight (Illinois), or the other end would creep.
        share = low + (high - low) * (low_weight - 0.5 * rule.gap_tolerance) / (low_weight - high_weight)
        inset = 0.02 * (high - low)
        share = min(max(share, low + inset), high - inset)
        to_object, to_hand = _gap_after(hand, field, rule, poses, state, f, j, share)
        if np.isnan(to_object):
            return ASK, 0.0, -1
        gap = min(to_object, to_hand)
        if gap > 0.0:
            low, low_gap, low_weight, high_weight = share, gap, gap, 0.5 * high_weight
            holding = state.nearest[0]
        else:
            high, high_weight, low_weight = share, gap, max(0.5 * low_weight, rule.gap_tolerance)
    return BLOCKED, low, OTHER_LINK if by_hand else holding


@njit(cache=True)
def _free_rounds(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, f: int
) -> int:
    """Bound from below how many rounds a finger can close without touching the object."""
    rounds = 1e9
    for j in range(hand.joint_count[f]):
        group = f * MOST_JOINTS + j
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            lower, _ = gap_bounds(hand, field, poses.group[group], shape)
            poses.bound[shape] = max(poses.bound[shape], lower)
            rounds = min(rounds, poses.bound[shape] / shape_motion(hand, shape, f, rule.step))
            if rounds < 1.0:
                return 0
    return int(rounds)


@njit(cache=True)
def _at_limit(hand: HandArrays, rule: ClosingRule, poses: HandPoses, f: int, j: int) -> bool:
    value = poses.joints[f, j] + rule.step * hand.speed[f, j]
    return value > hand.upper[f, j] + 1e-12 or value < hand.lower[f, j] - 1e-12


@njit(cache=True)
def _turn(hand: HandArrays, poses: HandPoses, f: int, j: int, turn: float) -> None:
    poses.joints[f, j] += turn
    carry_bounds(hand, poses, f, j, turn)


@njit(cache=True)
def _stamp_move(state: ClosingState, f: int, j: int) -> None:
    state.stamp[f, j:] += 1
    state.moves[0] += 1


@njit(cache=True)
def _glide(hand: HandArrays, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int) -> int:
    """Close a finger by one round that keeps clear of the object.

    Returns:
        FREE if it moved, BLOCKED if all its joints are at their limits, ASK if it would touch the hand itself
        (nothing is changed then).
    """
    before = poses.joints[f].copy()
    moved = False
    for j in range(hand.joint_count[f]):
        if not _at_limit(hand, rule, poses, f, j):
            poses.joints[f, j] += rule.step * hand.speed[f, j]
            moved = True
    if not moved:
        return BLOCKED
    place_finger(hand, poses, f, 0)
    if self_gap_of_finger(hand, poses, f, 0, False) <= 0.0:
        poses.joints[f] = before
        place_finger(hand, poses, f, 0)
        return ASK
    for j in range(hand.joint_count[f]):
        carry_bounds(hand, poses, f, j, poses.joints[f, j] - before[j])
    _stamp_move(state, f, 0)
    return FREE


@njit(cache=True)
def _stands(hand: HandArrays, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int, j: int) -> bool:
    """Whether a joint need not be tried: halted, at its limit, or held up by what has not moved since."""
    if state.halted[f] or _at_limit(hand, rule, poses, f, j):
        return True
    holding = state.blocked_by[f, j]
    if holding == OTHER_LINK:
        return state.blocked_at[f, j] == state.moves[0]
    return holding >= 0 and state.blocked_at[f, j] == state.stamp[f, holding]


@njit(cache=True)
def _keep_answers(hand: HandArrays, poses: HandPoses, state: ClosingState, share: float) -> None:
    """Take over the exact gaps measured at the posture that the finger has now."""
    for i in range(state.cursor[NOTES]):
        if state.note_share[i] == share:
            shape = state.note_shape[i]
            state.gap[shape] = state.note_gap[i]
            f = hand.shape_group[shape] // MOST_JOINTS
            state.gap_stamp[shape] = state.stamp[f, hand.shape_group[shape] - f * MOST_JOINTS]
            poses.bound[shape] = max(poses.bound[shape], state.note_gap[i])
    state.cursor[NOTES] = 0


@njit(cache=True)
def _step_joint(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int, j: int
) -> int:
    """Try one step of one joint: FREE if it moved, BLOCKED if not, ASK if a distance is missing."""
    if _stands(hand, rule, poses, state, f, j):
        return BLOCKED
    outcome, share, holding = _try_joint(hand, field, rule, poses, state, f, j)
    if outcome == ASK:
        return ASK
    moved = share > SMALLEST_MOVE
    if moved:
        _turn(hand, poses, f, j, share * rule.step * hand.speed[f, j])
        place_finger(hand, poses, f, j)
        _stamp_move(state, f, j)
    _keep_answers(hand, poses, state, share if moved else 0.0)
    state.blocked_by[f, j] = holding
    if holding == OTHER_LINK:
        state.blocked_at[f, j] = state.moves[0]
    elif holding >= 0:
        state.blocked_at[f, j] = state.stamp[f, holding]
    state.halted[f] = rule.whole_finger and outcome == BLOCKED and holding != OTHER_LINK
    return FREE if moved else BLOCKED


@njit(cache=True)
def _finish_finger_round(state: ClosingState, f: int) -> None:
    if state.cursor[MOVED] == 0:
        state.done[f] = True
    else:
        state.cursor[PASS_MOVED] = 1
    state.cursor[MOVED] = 0
    state.cursor[JOINT] = 0
    state.cursor[FINGER] = f + 1


@njit(cache=True)
def _next_round(state: ClosingState) -> bool:
    """Go on to the next round or pass; False when the hand is closed."""
    state.cursor[FINGER] = 0
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
def _glides(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int
) -> bool:
    """Let a finger close by one round at once if that is known to be free."""
    fresh = state.cursor[JOINT] == 0 and state.cursor[NOTES] == 0 and state.cursor[MOVED] == 0
    if not fresh or state.halted[f]:
        return False
    if state.credit[f] == 0:
        state.credit[f] = _free_rounds(hand, field, rule, poses, f)
    if state.credit[f] == 0:
        return False
    outcome = _glide(hand, rule, poses, state, f)
    if outcome == ASK:
        state.credit[f] = 0
        return False
    state.credit[f] -= 1
    state.cursor[MOVED] = 1 if outcome == FREE else 0
    return True


@njit(cache=True)
def advance(
    hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, state: ClosingState
) -> int:
    """Close the hand until it stops (``DONE``) or needs the exact gap of the shape returned.

    That shape's group then stands at ``poses.trial[group % MOST_JOINTS]``; see ``answer``.
    """
    F = hand.joint_count.shape[0]
    while True:
        f = state.cursor[FINGER]
        if f >= F:
            if not _next_round(state):
                return DONE
            continue
        if state.done[f]:
            state.cursor[FINGER] = f + 1
            continue
        if not _glides(hand, field, rule, poses, state, f):
            while state.cursor[JOINT] < hand.joint_count[f]:
                outcome = _step_joint(hand, field, rule, poses, state, f, state.cursor[JOINT])
                if outcome == ASK:
                    return state.cursor[ASKED]
                if outcome == FREE:
                    state.cursor[MOVED] = 1
                state.cursor[JOINT] += 1
        _finish_finger_round(state, f)
