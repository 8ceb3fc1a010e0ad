"""One trial: place the hand, test for collision, close the fingers, gather contacts, measure the grasp."""

from __future__ import annotations

import time
from types import TracebackType

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping import closing
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.closing import ASKED, NOTES, ClosingRule
from mebo_grasp.grasping.distance_field import build_field
from mebo_grasp.grasping.hand_arrays import FREE_AT_START, MOST_JOINTS, build_hand_arrays
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.quality import GraspMetrics, measure
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

FloatArray = npt.NDArray[np.float64]


class GraspSimulator:
    """Executes trials of one hand on one object; the same pose gives the same grasp, bit for bit.

    Args:
        target: the object.
        hand: the hand; its joints start at the preshape.
        settings: how a trial is executed and measured.

    Raises:
        InvalidHandError: the hand's chains are longer than the closing loop takes, or nothing can collide.
    """

    def __init__(self, target: TargetObject, hand: HandModel, settings: TrialSettings | None = None) -> None:
        self.target = target
        self.hand = hand
        self.settings = settings or TrialSettings()
        self._arrays, self._layout = build_hand_arrays(hand, hand.preshape)
        self._state = closing.new_state(self._arrays)
        closing.drop_touching_pairs(self._arrays, self._state, FREE_AT_START)
        self._field = build_field(target.mesh, target.solid_parts)
        self._rule = ClosingRule(self.settings.step, self.settings.gap_tolerance, self.settings.whole_finger)
        self._asked = np.zeros(len(self._arrays.shape_group), dtype=np.bool_)
        self._static_group = len(hand.fingers) * MOST_JOINTS
        self._world = BulletWorld(target, self._layout.shapes, self._layout.T_group_shape)

    def trial(self, T_object_tcp: Pose) -> Grasp:
        """Execute one trial.

        Args:
            T_object_tcp: pose of the hand's TCP in the object's frame.

        Returns:
            The grasp; its outcome is COLLISION if the open hand overlaps the object, NO_CONTACT if the closed
            hand does not touch it, and GRASPED otherwise.
        """
        begun = time.perf_counter()
        closing.begin(self._arrays, self._state, T_object_tcp.matrix)
        if self._collides():
            return self._grasp(T_object_tcp, GraspOutcome.COLLISION, (), GraspMetrics(), begun)
        self._close_fingers()
        contacts = self._contacts()
        if not contacts:
            return self._grasp(T_object_tcp, GraspOutcome.NO_CONTACT, (), GraspMetrics(), begun)
        metrics = measure(contacts, self.target, self.settings)
        return self._grasp(T_object_tcp, GraspOutcome.GRASPED, contacts, metrics, begun)

    def close(self) -> None:
        """Free the physics engine; closing twice does no harm."""
        self._world.close()

    def __enter__(self) -> GraspSimulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _collides(self) -> bool:
        state = self._state
        self._asked[:] = False
        if closing.starts_in_collision(self._arrays, self._field, state, self._asked):
            return True
        for shape in np.flatnonzero(self._asked):
            gap, _, _ = self._world.closest(shape, self._group_pose(shape))
            if gap <= 0.0:
                return True
        return False

    def _close_fingers(self) -> None:
        state = self._state
        while closing.advance(self._arrays, self._field, self._rule, state) != closing.DONE:
            shape = int(state.cursor[ASKED])
            pose = state.trial_pose[self._arrays.shape_group[shape] % MOST_JOINTS]
            gap, _, _ = self._world.closest(shape, pose)
            state.note_gap[state.cursor[NOTES]] = gap
            state.cursor[NOTES] += 1

    def _contacts(self) -> tuple[GraspContact, ...]:
        """Return a contact for each link that touches, at the final posture."""
        contacts = []
        for shape in range(len(self._layout.shapes)):
            reach = self._contact_reach(shape)
            if reach <= 0.0:
                continue
            pose = self._group_pose(shape)
            lower, _ = closing.gap_bounds(self._arrays, self._field, pose, shape)
            if lower > reach:
                continue
            gap, point, inward = self._world.closest(shape, pose)
            if gap <= reach and point is not None and inward is not None:
                normal = np.array(inward) / np.linalg.norm(inward)
                contacts.append(GraspContact(self._layout.shapes[shape].link, np.array(point), normal))
        return tuple(contacts)

    def _contact_reach(self, shape: int) -> float:
        """Return the gap within which a shape gives a contact; 0 if it gives none."""
        if self._arrays.shape_group[shape] == self._static_group:
            return self.settings.palm_distance if self.settings.palm_contacts else 0.0
        if self.settings.contact_rule == "pressing":
            return np.inf if bool(self._state.pressing[:, shape].any()) else 0.0
        return self.settings.gap_tolerance

    def _group_pose(self, shape: int) -> FloatArray:
        pose: FloatArray = self._state.group_pose[self._arrays.shape_group[shape]]
        return pose

    def _posture(self) -> HandPosture:
        values = dict(zip(self.hand.preshape.names, self.hand.preshape.positions, strict=True))
        for f, joints in enumerate(self._layout.joints):
            for j, name in enumerate(joints):
                values[name] = float(self._state.joints[f, j])
        return HandPosture(tuple(values), tuple(values.values()))

    def _grasp(
        self, T_object_tcp: Pose, outcome: GraspOutcome, contacts: tuple[GraspContact, ...], metrics: GraspMetrics,
        begun: float,
    ) -> Grasp:
        return Grasp(
            T_object_tcp, outcome, metrics.quality, metrics.epsilon, metrics.volume, metrics.isotropy,
            metrics.force_closure, contacts, self._posture(), self.target.object_id, self.hand.name,
            time.perf_counter() - begun,
        )
