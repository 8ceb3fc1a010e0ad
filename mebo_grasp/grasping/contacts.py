"""The contacts of a closed hand: which links touch the object, where, and in which direction they press."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.distance_field import DistanceField
from mebo_grasp.grasping.engine import BULLET, QUERY_RANGE, Engine, exact_gap, fast_contact
from mebo_grasp.grasping.hand_arrays import BOX, MOST_JOINTS, MOST_SHAPES, HandArrays, HandLayout
from mebo_grasp.grasping.hand_motion import HandPoses, gap_bounds, try_joint_value
from mebo_grasp.grasping.joint_step import ClosingRule
from mebo_grasp.grasping.trial import TrialSettings

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


class ContactFinder:
    """Finds the contacts of one hand on one object.

    Args:
        hand, layout: the hand.
        field: the object's signed distances.
        engine: where exact gaps come from.
        world: asked for what the compiled engine does not measure, and for all if it is the engine.
        rule: how the hand closes.
        settings: which links give contacts, and from how near.
    """

    def __init__(
        self, hand: HandArrays, layout: HandLayout, field: DistanceField, engine: Engine, world: BulletWorld,
        rule: ClosingRule, settings: TrialSettings,
    ) -> None:
        self._hand, self._layout, self._field, self._engine = hand, layout, field, engine
        self._world, self._rule, self._pressing = world, rule, settings.contact_rule == "pressing"
        still = hand["shape_group"][: len(layout.shapes)] == hand["fingers"] * MOST_JOINTS
        of_still = settings.palm_distance if settings.palm_contacts else -np.inf
        self._reach = np.full(MOST_SHAPES, -np.inf)
        self._reach[: len(still)] = np.where(still, of_still, settings.gap_tolerance)
        self._near = np.empty(MOST_SHAPES, dtype=np.int64)
        self._points = np.empty((MOST_SHAPES, 2, 3))

    def find(self, poses: HandPoses) -> Contacts:
        """Return a contact for each link that touches where the hand stands, in the order of its shapes."""
        reach = self._reach
        if self._pressing:
            reach = reach.copy()
            mark_pressing(self._hand, self._field, self._engine, self._rule, poses, reach)
        count = find_near(self._hand, self._field, self._engine, poses, reach, self._near, self._points)
        links, points, normals = [], [], []
        for i, shape in enumerate(self._near[:count].tolist()):
            on_hand, on_object = self._points[i]
            if np.isnan(on_hand[0]):
                group = poses["group"][self._hand["shape_group"][shape]]
                gap, point, inward = self._world.closest(shape, group)
                if gap > reach[shape] or point is None or inward is None:
                    continue
                on_object, direction = np.array(point), np.array(inward)
            else:
                direction = on_object - on_hand
            links.append(self._layout.shapes[shape].link)
            points.append(on_object)
            normals.append(direction / np.sqrt(direction @ direction))
        return Contacts(tuple(links), np.array(points).reshape(-1, 3), np.array(normals).reshape(-1, 3))


@njit(cache=True)
def find_near(
    hand: HandArrays, field: DistanceField, engine: Engine, poses: HandPoses, reach: FloatArray, near: IntArray,
    points: FloatArray,
) -> int:
    """Find the shapes whose gap may be within ``reach``, shape (MOST_SHAPES,), metres.

    Writes the shapes into ``near``, and into ``points``, shape (MOST_SHAPES, 2, 3), the nearest points of a rod's
    axis and of the object; NaN where only Bullet can tell whether and where the shape touches.

    Returns:
        How many there are.
    """
    count = 0
    for shape in range(hand.shapes):
        pose = poses.group[hand.shape_group[shape]]
        if reach[shape] <= 0.0 or gap_bounds(hand, field, pose, shape)[0] > reach[shape]:
            continue
        if engine.kind == BULLET or hand.kind[shape] == BOX:
            points[count] = np.nan
        elif fast_contact(engine.tree, hand, pose, shape, QUERY_RANGE, points[count]) > reach[shape]:
            continue
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


__all__ = ["ContactFinder", "Contacts"]
