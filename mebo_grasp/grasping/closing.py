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

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.engine import Engine, exact_gap
from mebo_grasp.grasping.hand_arrays import MOST_JOINTS, HandArrays
from mebo_grasp.grasping.hand_motion import (
    HandPoses,
    carry_bounds,
    gap_bounds,
    place_finger,
    place_hand,
    self_gap_of_finger,
    shape_motion,
)
from mebo_grasp.grasping.joint_step import (
    BLOCKED,
    FREE,
    OBJECT,
    TOUCHES,
    ClosingRule,
    ClosingState,
    confirm_gaps,
    try_joint,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_ROUNDS = 4000
MOST_PASSES = 12
SMALLEST_MOVE = 2e-4
"""A joint that can move by less than this share of a step counts as blocked."""


@njit(cache=True)
def _begin(state: ClosingState) -> None:
    state.done[:] = 0
    state.halted[:] = 0
    state.credit[:] = 0
    state.stamp[:] = 0
    state.blocked_by[:] = -1
    state.gap_stamp[:] = -1


@njit(cache=True)
def starts_in_collision(hand: HandArrays, field: DistanceField, engine: Engine, poses: HandPoses) -> bool:
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
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    T: FloatArray,
) -> bool:
    """Place the open hand and close it; False if it collides where it is placed."""
    place_hand(hand, poses, T)
    engine.state[0].nearest[:] = -1
    if starts_in_collision(hand, field, engine, poses):
        return False
    close_fingers(hand, field, engine, rule, poses, state)
    return True


@njit(cache=True)
def _free_rounds(hand: HandArrays, field: DistanceField, rule: ClosingRule, poses: HandPoses, f: int) -> int:
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
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
    j: int,
) -> bool:
    """Try one step of one joint; return whether it moved."""
    if _stands(hand, rule, poses, state, f, j):
        return False
    outcome, share, holding, on = try_joint(hand, field, engine, rule, poses, state, f, j)
    moved = share > 0.0
    if moved:
        poses.joints[f, j] += share * rule.step * hand.speed[f, j]
        carry_bounds(hand, poses, f, j, share * rule.step * hand.speed[f, j])
        place_finger(hand, poses, f, j)
        _stamp_move(state, f, j)
    confirm_gaps(hand, poses, state, f, j)
    state.blocked_by[f, j], state.blocked_on[f, j] = holding, on
    if holding >= 0:
        state.blocked_at[f, j] = _moves_of_contact(hand, state, f, holding, on)
    if rule.whole_finger and outcome == BLOCKED and on == OBJECT:
        state.halted[f] = 1
    return share > SMALLEST_MOVE


@njit(cache=True)
def _close_finger_round(
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    f: int,
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
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: HandPoses,
    state: ClosingState,
    shares: FloatArray,
) -> None:
    """Write how much of a step each joint of a closed hand could still make, shape (fingers, MOST_JOINTS)."""
    for f in range(hand.fingers):
        for j in range(hand.joint_count[f]):
            if not _at_limit(hand, rule, poses, f, j):
                _, shares[f, j], _, _ = try_joint(hand, field, engine, rule, poses, state, f, j)
