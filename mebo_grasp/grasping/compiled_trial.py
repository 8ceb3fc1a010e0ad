"""A trial up to its contacts in one call of compiled code.

Handing the hand, the field and the engine over to compiled code costs 5 to 20 microseconds a call, as much as a whole
trial that ends in a collision; so a trial makes one call, and its records are handed over in arrays of one element,
which are recognized faster than records.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping import closing, hand_motion
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.contacts import Contacts, find_near, mark_pressing
from mebo_grasp.grasping.distance_field import DistanceField, borrowed_field
from mebo_grasp.grasping.engine import Engine, borrowed_engine
from mebo_grasp.grasping.hand_arrays import HAND_TYPE, MOST_JOINTS, MOST_SHAPES, HandArrays, HandLayout
from mebo_grasp.grasping.joint_step import STATE_TYPE, ClosingRule
from mebo_grasp.grasping.trial import TrialSettings

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

COLLISION = -1


@njit(cache=True)
def run_trial(
    hands: npt.NDArray[np.void],
    field: DistanceField,
    engine: Engine,
    rule: ClosingRule,
    poses: npt.NDArray[np.void],
    states: npt.NDArray[np.void],
    T: FloatArray,
    pressing: bool,
    reach: FloatArray,
    near: IntArray,
    points: FloatArray,
    normals: FloatArray,
) -> int:
    """Place the open hand, close it and find contacts as ``find_near`` does; ``COLLISION`` if it cannot stand there."""
    hand, field, engine = hands[0], borrowed_field(field), borrowed_engine(engine)
    if not closing.run_trial(hand, field, engine, rule, poses[0], states[0], T):
        return COLLISION
    if pressing:
        mark_pressing(hand, field, engine, rule, poses[0], reach)
    return find_near(hand, field, engine, poses[0], reach, near, points, normals)


class TrialRunner:
    """Runs trials of one hand in one posture on one object, up to the contacts.

    Args:
        hand, layout: the hand.
        field: the object's signed distances.
        engine: where exact gaps come from.
        world: asked for what the compiled engine does not measure, and for all if it is the engine.
        rule: how the hand closes.
        settings: which links give contacts, and from how near.

    Attributes:
        hand, field, engine, rule: as given.
        poses, state: where the hand stands after the last trial, and how it came there.
    """

    def __init__(
        self,
        hand: HandArrays,
        layout: HandLayout,
        field: DistanceField,
        engine: Engine,
        world: BulletWorld,
        rule: ClosingRule,
        settings: TrialSettings,
    ) -> None:
        self.hand, self.field, self.engine, self.rule = hand, field, engine, rule
        self._hands = np.zeros(1, HAND_TYPE)
        self._hands[0] = hand
        self._all_poses, self._states = hand_motion.new_poses(), np.zeros(1, STATE_TYPE)
        self.poses, self.state = self._all_poses[0], self._states[0]
        self._links = [shape.link for shape in layout.shapes]
        self._world, self._pressing = world, settings.contact_rule == "pressing"
        still = hand["shape_group"][: len(layout.shapes)] == hand["fingers"] * MOST_JOINTS
        of_still = settings.palm_distance if settings.palm_contacts else -np.inf
        self._least_reach = np.full(MOST_SHAPES, -np.inf)
        self._least_reach[: len(still)] = np.where(still, of_still, settings.gap_tolerance)
        self._reach = self._least_reach.copy()
        self._near = np.empty(MOST_SHAPES, dtype=np.int64)
        self._points, self._normals = np.empty((MOST_SHAPES, 3)), np.empty((MOST_SHAPES, 3))

    def run(self, T_object_tcp: FloatArray) -> Contacts | None:
        """Run one trial; return a contact for each link that touches, in the order of its shapes, None if it collides.

        Args:
            T_object_tcp: pose of the TCP, (4, 4).
        """
        if self._pressing:
            self._reach[:] = self._least_reach
        count = run_trial(
            self._hands,
            self.field,
            self.engine,
            self.rule,
            self._all_poses,
            self._states,
            T_object_tcp,
            self._pressing,
            self._reach,
            self._near,
            self._points,
            self._normals,
        )
        if count == COLLISION:
            return None
        shapes = self._near[:count].tolist()
        if count and np.isnan(self._points[:count, 0]).any():
            kept = [i for i in range(count) if self._complete(i, shapes[i])]
            points, normals = self._points[kept], self._normals[kept]
            shapes = [shapes[i] for i in kept]
        else:
            points, normals = self._points[:count].copy(), self._normals[:count].copy()
        return Contacts(tuple([self._links[shape] for shape in shapes]), points, normals)

    def _complete(self, i: int, shape: int) -> bool:
        """Whether a shape touches; its point and normal are asked of Bullet where only Bullet can tell."""
        if not np.isnan(self._points[i, 0]):
            return True
        group = self.poses["group"][self.hand["shape_group"][shape]]
        gap, point, inward = self._world.closest(shape, group)
        if gap > self._reach[shape] or point is None or inward is None:
            return False
        x, y, z = inward
        length = (x * x + y * y + z * z) ** 0.5
        self._points[i], self._normals[i] = point, (x / length, y / length, z / length)
        return True
