"""The contacts of a closed hand: which links touch the object, where, and in which direction they press."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.engine import BULLET, QUERY_RANGE, Engine, exact_gap, fast_contact
from mebo_grasp.grasping.hand_arrays import BOX, MOST_JOINTS, HandArrays
from mebo_grasp.grasping.hand_motion import HandPoses, gap_bounds, try_joint_value
from mebo_grasp.grasping.joint_step import ClosingRule

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Contacts(NamedTuple):
    """Contacts in the object's frame.

    Attributes:
        links: name of the link of each.
        points: (n, 3) on the object's surface, metres.
        normals: (n, 3) unit, into the object.
    """

    links: tuple[str, ...]
    points: FloatArray
    normals: FloatArray


@njit(cache=True)
def find_near(
    hand: HandArrays,
    field: DistanceField,
    engine: Engine,
    poses: HandPoses,
    reach: FloatArray,
    near: IntArray,
    points: FloatArray,
    normals: FloatArray,
) -> int:
    """Find the shapes whose gap may be within ``reach``, shape (MOST_SHAPES,), metres.

    Writes the shapes into ``near``, their points on the object and unit normals into it into ``points`` and
    ``normals``, each (MOST_SHAPES, 3); NaN where only Bullet can tell whether and where the shape touches.

    Returns:
        How many there are.
    """
    count, pair, state = 0, np.empty((2, 3)), engine.state[0]
    for shape in range(hand.shapes):
        pose = poses.group[hand.shape_group[shape]]
        if reach[shape] <= 0.0 or gap_bounds(hand, field, pose, shape)[0] > reach[shape]:
            continue
        if hand.kind[shape] == BOX or (state.kind == BULLET and not state.screened[shape]):
            points[count] = np.nan
        else:
            gap = fast_contact(engine, hand, pose, shape, QUERY_RANGE, pair)
            if gap > reach[shape]:
                continue
            # The first point lies on the rod's axis.
            for k in range(3):
                points[count, k] = pair[1, k]
                normals[count, k] = (pair[1, k] - pair[0, k]) / (gap + hand.radius[shape])
        near[count] = shape
        count += 1
    return count


@njit(cache=True)
def mark_pressing(
    hand: HandArrays, field: DistanceField, engine: Engine, rule: ClosingRule, poses: HandPoses, reach: FloatArray
) -> None:
    """Set the reach of every shape that one more step of one joint would bring into the object to the farthest."""
    for f in range(hand.fingers):
        for j in range(hand.joint_count[f]):
            value = poses.joints[f, j] + rule.step * hand.speed[f, j]
            if not hand.lower[f, j] <= value <= hand.upper[f, j]:
                continue
            try_joint_value(hand, poses, f, j, value)
            for i in range(j, hand.joint_count[f]):
                group = f * MOST_JOINTS + i
                for shape in range(hand.group_shapes[group], hand.group_shapes[group + 1]):
                    if gap_bounds(hand, field, poses.trial[i], shape)[0] > 0.0:
                        continue
                    if exact_gap(engine, hand, field, poses.trial[i], shape) <= 0.0:
                        reach[shape] = QUERY_RANGE
