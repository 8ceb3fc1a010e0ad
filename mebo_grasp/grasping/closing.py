"""The closing of a hand on an object, compiled: when does which joint stop?

Rule (thesis, section 6; the end-effector of Simox): every finger closes all its joints by a small step a
round, from the palm outwards. A joint whose step would bring a link of its finger into the object or into
another link goes as far as it can (here to a gap below ``gap_tolerance``, by root search) and stops; its
outer joints go on. A finger is done when none of its joints can move. When all are done, every finger is
tried once more, until a whole pass moves nothing.

Bounds on the gaps, from the distance field and from how far links can have moved, decide most steps; only
where they cannot is the exact gap asked of the engine.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.engine import BULLET, Engine, exact_gap
from mebo_grasp.grasping.hand_arrays import MOST_FINGERS, MOST_JOINTS, MOST_SHAPES, HandArrays
from mebo_grasp.grasping.hand_motion import (
    HandPoses,
    carry_bounds,
    gap_bounds,
    place_finger,
    place_hand,
    self_gap_of_finger,
    shape_motion,
    try_joint_value,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_ROUNDS = 4000
MOST_PASSES = 12
MOST_SEARCH_STEPS = 24
SMALLEST_MOVE = 2e-4
"""A joint that can move by less than this share of a step counts as blocked."""

FREE, BLOCKED, TOUCHES = 0, 1, 2
OBJECT = -1


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


STATE_TYPE = np.dtype(
    [
        ("done", np.int64, (MOST_FINGERS,)),
        ("halted", np.int64, (MOST_FINGERS,)),
        ("credit", np.int64, (MOST_FINGERS,)),
        ("stamp", np.int64, (MOST_FINGERS, MOST_JOINTS)),
        ("blocked_by", np.int64, (MOST_FINGERS, MOST_JOINTS)),
        ("blocked_on", np.int64, (MOST_FINGERS, MOST_JOINTS)),
        ("blocked_at", np.int64, (MOST_FINGERS, MOST_JOINTS)),
        ("gap", np.float64, (MOST_SHAPES,)),
        ("gap_stamp", np.int64, (MOST_SHAPES,)),
        ("seen", np.float64, (MOST_SHAPES,)),
        ("hit", np.int64, (MOST_SHAPES,)),
        ("nearest", np.int64),
    ],
    align=True,
)
"""What changes while a hand closes, besides its poses.

done: whether a finger is done in this pass
halted: whether a finger is stopped for good (rule ``whole_finger``)
credit: rounds that a finger can close clear of the object
stamp: number of moves of the group of joint j, which joints up to j move
blocked_by: which joint's group holds a joint up by what it touches; -1 if that is not known
blocked_on: what it touches: a finger, the number of fingers for the still part of the hand, or OBJECT
blocked_at: moves of both (see ``_moves_of_contact``) when it did
gap, gap_stamp: exact gap of a shape, and the stamp of its group then; -1 never
seen: exact gap of a shape in the posture last tried, NaN if a bound was enough
hit: whether the full step now tried brings a shape into the object
nearest: joint of the innermost group that touches in the posture last tried; -1 none
"""

ClosingState: TypeAlias = Any
"""A record of ``STATE_TYPE``."""


def new_state() -> ClosingState:
    """Allocate the state."""
    return np.zeros(1, STATE_TYPE)[0]


@njit(cache=True)
def _begin(state: ClosingState) -> None:
    state.done[:] = 0
    state.halted[:] = 0
    state.credit[:] = 0
    state.stamp[:] = 0
    state.blocked_by[:] = -1
    state.gap_stamp[:] = -1


@njit(cache=True)
def starts_in_collision(
    hand: HandArrays, field: DistanceField, engine: Engine, poses: HandPoses
) -> bool:
    """Whether the hand overlaps the object where it stands; else the gaps of its shapes are bounded."""
    for shape in range(hand.shapes):
        lower, upper = gap_bounds(hand, field, poses.group[hand.shape_group[shape]], shape)
        if upper < 0.0:
            return True
        poses.bound[shape] = lower
    for shape in range(hand.shapes):
        if poses.bound[shape] <= 0.0:
            gap = exact_gap(engine, hand, field, poses.group[hand.shape_group[shape]], shape)
            if gap <= 0.0:
                return True
            poses.bound[shape] = gap
    return False


@njit(cache=True)
def run_trial(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, T: FloatArray,
) -> bool:
    """Place the open hand and close it; False if it collides where it is placed."""
    place_hand(hand, poses, T)
    if starts_in_collision(hand, field, engine, poses):
        return False
    close_fingers(hand, field, engine, rule, poses, state)
    return True


@njit(cache=True)
def _gap_after(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int, j: int, share: float, quick: bool = False,
) -> tuple[float, float]:
    """Return the smallest gaps to the object and to the hand after a share of a step.

    Gaps beyond the tolerance may be lower bounds; quick ones may differ a little from the engine's.
    """
    turn = share * rule.step * hand.speed[f, j]
    try_joint_value(hand, poses, f, j, poses.joints[f, j] + turn)
    to_object = np.inf
    state.nearest = -1
    for i in range(j, hand.joint_count[f]):
        group = f * MOST_JOINTS + i
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            motion = abs(turn) * hand.reach[shape, j]
            gap = _gap_of_shape_after(hand, field, engine, rule, poses, state, shape, i, motion, quick)
            if share == 1.0:
                state.hit[shape] = 1 if gap <= 0.0 else 0
            if 0.0 < gap <= rule.gap_tolerance and state.hit[shape] == 1 and state.nearest < 0:
                state.nearest = i
            to_object = min(to_object, gap)
    return to_object, self_gap_of_finger(hand, poses, f, j, turn)


@njit(cache=True)
def _gap_of_shape_after(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, shape: int, i: int, motion: float, quick: bool,
) -> float:
    """Return a shape's gap at the posture tried, exact where it may be below the tolerance."""
    state.seen[shape] = np.nan
    f = hand.shape_group[shape] // MOST_JOINTS
    if motion == 0.0 and state.gap_stamp[shape] == state.stamp[f, i]:
        state.seen[shape] = state.gap[shape]
        return state.gap[shape]
    lower = poses.bound[shape] - motion
    if lower <= rule.gap_tolerance:
        lower = max(lower, gap_bounds(hand, field, poses.trial[i], shape)[0])
    if lower > rule.gap_tolerance:
        return lower
    state.seen[shape] = exact_gap(engine, hand, field, poses.trial[i], shape, quick)
    return state.seen[shape]


@njit(cache=True)
def _keep_gaps(hand: HandArrays, state: ClosingState, f: int, j: int) -> None:
    """Remember the gaps of the posture last tried, to which the finger will move if nothing better is found."""
    for group in range(f * MOST_JOINTS + j, (f + 1) * MOST_JOINTS):
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            state.gap[shape] = state.seen[shape]


@njit(cache=True)
def _confirm_gaps(hand: HandArrays, poses: HandPoses, state: ClosingState, f: int, j: int) -> None:
    """Take the gaps remembered for those of the present posture."""
    for i in range(j, hand.joint_count[f]):
        group = f * MOST_JOINTS + i
        for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
            if np.isnan(state.gap[shape]):
                state.gap_stamp[shape] = -1
            else:
                state.gap_stamp[shape] = state.stamp[f, i]
                poses.bound[shape] = max(poses.bound[shape], state.gap[shape])


@njit(cache=True)
def _try_joint(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int, j: int,
) -> tuple[int, float, int, int]:
    """Find how far a joint can go in one step.

    Returns:
        The outcome, the share of the step, and what holds the joint up: the joint of the group that touches, -1 if
        that is not known, and what it touches.
    """
    to_object, to_hand = _gap_after(hand, field, engine, rule, poses, state, f, j, 1.0)
    if to_object > 0.0 and to_hand > 0.0:
        _keep_gaps(hand, state, f, j)
        return FREE, 1.0, -1, OBJECT
    by_hand = to_object > 0.0
    hit_by, hit_finger = poses.near_joint, poses.near_finger
    low, high, high_weight = 0.0, 1.0, min(to_object, to_hand)
    low_gap, holding, on = _gap_and_holder(hand, field, engine, rule, poses, state, f, j, 0.0, by_hand)
    low_weight = low_gap
    _keep_gaps(hand, state, f, j)
    share = -1.0
    if engine.kind == BULLET and not by_hand and low_gap > rule.gap_tolerance:
        share = _guess(hand, field, engine, rule, poses, state, f, j, low_gap, high_weight)
    for _ in range(MOST_SEARCH_STEPS):
        if low_gap <= rule.gap_tolerance:
            break
        if not low < share < high:
            share = _between(low, high, low_weight, high_weight, rule.gap_tolerance)
        gap, i, g = _gap_and_holder(hand, field, engine, rule, poses, state, f, j, share, by_hand)
        if gap > 0.0:
            low, low_gap, low_weight, high_weight = share, gap, gap, 0.5 * high_weight
            holding, on = i, g
            _keep_gaps(hand, state, f, j)
        else:
            high, high_weight, low_weight = share, gap, max(0.5 * low_weight, rule.gap_tolerance)
    if by_hand and (holding != hit_by or on != hit_finger):
        # It touches one link here and would run into another: either may give way.
        holding = -1
    return BLOCKED, low, holding, on


@njit(cache=True)
def _between(low: float, high: float, low_weight: float, high_weight: float, tolerance: float) -> float:
    """Return the next share to try.

    Regula falsi towards half the tolerance, kept away from the ends of the bracket; an end that stays put loses
    weight (Illinois), or the other end would creep.
    """
    share = low + (high - low) * (low_weight - 0.5 * tolerance) / (low_weight - high_weight)
    inset = 0.02 * (high - low)
    return min(max(share, low + inset), high - inset)


@njit(cache=True)
def _guess(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int, j: int, low_weight: float, high_weight: float,
) -> float:
    """Return the share of a step at which the compiled gap is within the tolerance: Bullet's hardly differs."""
    low, high, share = 0.0, 1.0, 0.5
    for _ in range(MOST_SEARCH_STEPS):
        share = _between(low, high, low_weight, high_weight, rule.gap_tolerance)
        gap = min(*_gap_after(hand, field, engine, rule, poses, state, f, j, share, True))
        if 0.0 < gap <= rule.gap_tolerance:
            break
        if gap > 0.0:
            low, low_weight, high_weight = share, gap, 0.5 * high_weight
        else:
            high, high_weight, low_weight = share, gap, max(0.5 * low_weight, rule.gap_tolerance)
    return share


@njit(cache=True)
def _gap_and_holder(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int, j: int, share: float, by_hand: bool,
) -> tuple[float, int, int]:
    """Return the smallest gap after a share of a step, the joint of the group that touches there, and what it touches.

    Only a link within the tolerance touches; the joint is -1 if none does.
    """
    to_object, to_hand = _gap_after(hand, field, engine, rule, poses, state, f, j, share)
    gap = min(to_object, to_hand)
    if not by_hand:
        return gap, state.nearest, OBJECT
    return gap, poses.near_joint if 0.0 < to_hand <= rule.gap_tolerance else -1, poses.near_finger


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
def _stamp_move(state: ClosingState, f: int, j: int) -> None:
    state.stamp[f, j:] += 1


@njit(cache=True)
def _moves_of_contact(hand: HandArrays, state: ClosingState, f: int, i: int, on: int) -> int:
    """Count the moves of group i of finger f and of what it touches; the object and the palm never move."""
    moves = state.stamp[f, i]
    if 0 <= on < hand.fingers:
        moves += state.stamp[on, MOST_JOINTS - 1]
    return moves


@njit(cache=True)
def _glide(hand: HandArrays, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int) -> int:
    """Close a finger by one round that keeps clear of the object.

    Returns:
        FREE if it moved, BLOCKED if all its joints are at their limits, TOUCHES if it would touch the hand itself
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
    for j in range(hand.joint_count[f]):
        carry_bounds(hand, poses, f, j, poses.joints[f, j] - before[j])
    place_finger(hand, poses, f, 0)
    if self_gap_of_finger(hand, poses, f, 0, 0.0) <= 0.0:
        poses.joints[f] = before
        place_finger(hand, poses, f, 0)
        return TOUCHES
    _stamp_move(state, f, 0)
    return FREE


@njit(cache=True)
def _stands(hand: HandArrays, rule: ClosingRule, poses: HandPoses, state: ClosingState, f: int, j: int) -> bool:
    """Whether a joint need not be tried: halted, at its limit, or held up by what has not moved since."""
    if state.halted[f] == 1 or _at_limit(hand, rule, poses, f, j):
        return True
    i = state.blocked_by[f, j]
    return i >= 0 and state.blocked_at[f, j] == _moves_of_contact(hand, state, f, i, state.blocked_on[f, j])


@njit(cache=True)
def _step_joint(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int, j: int,
) -> bool:
    """Try one step of one joint; return whether it moved."""
    if _stands(hand, rule, poses, state, f, j):
        return False
    outcome, share, holding, on = _try_joint(hand, field, engine, rule, poses, state, f, j)
    moved = share > 0.0
    if moved:
        poses.joints[f, j] += share * rule.step * hand.speed[f, j]
        carry_bounds(hand, poses, f, j, share * rule.step * hand.speed[f, j])
        place_finger(hand, poses, f, j)
        _stamp_move(state, f, j)
    _confirm_gaps(hand, poses, state, f, j)
    state.blocked_by[f, j], state.blocked_on[f, j] = holding, on
    if holding >= 0:
        state.blocked_at[f, j] = _moves_of_contact(hand, state, f, holding, on)
    if rule.whole_finger and outcome == BLOCKED and on == OBJECT:
        state.halted[f] = 1
    return share > SMALLEST_MOVE


@njit(cache=True)
def _close_finger_round(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses,
    state: ClosingState, f: int,
) -> bool:
    """Close a finger by one round, at once if that is known to be free; return whether anything moved."""
    if state.credit[f] == 0 and state.halted[f] == 0:
        state.credit[f] = _free_rounds(hand, field, rule, poses, f)
    if state.credit[f] > 0 and state.halted[f] == 0:
        outcome = _glide(hand, rule, poses, state, f)
        state.credit[f] = 0 if outcome == TOUCHES else state.credit[f] - 1
        if outcome != TOUCHES:
            return outcome == FREE
    moved = False
    for j in range(hand.joint_count[f]):
        if _step_joint(hand, field, engine, rule, poses, state, f, j):
            moved = True
    return moved


@njit(cache=True)
def close_fingers(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses, state: ClosingState
) -> int:
    """Close a placed hand until a whole pass moves nothing; return the number of rounds."""
    _begin(state)
    F = hand.fingers
    rounds = 0
    for _ in range(MOST_PASSES):
        pass_moved = False
        state.done[:] = 0
        state.credit[:] = 0
        while np.sum(state.done) < F and rounds < MOST_ROUNDS:
            rounds += 1
            for f in range(F):
                if not state.done[f]:
                    moved = _close_finger_round(hand, field, engine, rule, poses, state, f)
                    state.done[f] = 0 if moved else 1
                    pass_moved = pass_moved or moved
        if not pass_moved:
            break
    return rounds


@njit(cache=True)
def free_shares(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses, state: ClosingState,
    shares: FloatArray,
) -> None:
    """Write how much of a step each joint of a closed hand could still make, shape (fingers, MOST_JOINTS)."""
    for f in range(hand.fingers):
        for j in range(hand.joint_count[f]):
            if not _at_limit(hand, rule, poses, f, j):
                _, shares[f, j], _, _ = _try_joint(hand, field, engine, rule, poses, state, f, j)
