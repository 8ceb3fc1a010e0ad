"""How far one joint of a closing hand can go in one step, compiled.

The object and the other links hold a joint up. Where a whole step would run into either, the share of it that
leaves a gap below the tolerance is found by root search.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.engine import BULLET, Engine, exact_gap
from mebo_grasp.grasping.hand_arrays import MOST_FINGERS, MOST_JOINTS, MOST_SHAPES, HandArrays
from mebo_grasp.grasping.hand_motion import HandPoses, gap_bounds, self_gap_of_finger, try_joint_value

FloatArray = npt.NDArray[np.float64]

MOST_SEARCH_STEPS = 24
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


@njit(cache=True)
def _gap_after(
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
    j: int,
    share: float,
    quick: bool = False,
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
    if share == 1.0 and to_object <= 0.0:
        # The object stops this step; whether the hand would too is asked where it can go.
        return to_object, np.inf
    return to_object, self_gap_of_finger(hand, poses, f, j, turn)


@njit(cache=True)
def _gap_of_shape_after(
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    shape: int,
    i: int,
    motion: float,
    quick: bool,
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
def confirm_gaps(hand: HandArrays, poses: HandPoses, state: ClosingState, f: int, j: int) -> None:
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
def try_joint(
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
    j: int,
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
    if engine.state[0].kind == BULLET and not by_hand and low_gap > rule.gap_tolerance:
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
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
    j: int,
    low_weight: float,
    high_weight: float,
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
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
    j: int,
    share: float,
    by_hand: bool,
) -> tuple[float, int, int]:
    """Return the smallest gap after a share of a step, the joint of the group that touches there, and what it touches.

    Only a link within the tolerance touches; the joint is -1 if none does.
    """
    to_object, to_hand = _gap_after(hand, field, engine, rule, poses, state, f, j, share)
    gap = min(to_object, to_hand)
    if not by_hand:
        return gap, state.nearest, OBJECT
    return gap, poses.near_joint if 0.0 < to_hand <= rule.gap_tolerance else -1, poses.near_finger
