"""One trial: place the hand, test for collision, close the fingers, gather contacts, measure the grasp."""

from __future__ import annotations

import time
from types import TracebackType

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping import closing, hand_motion
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.closing import ClosingRule
from mebo_grasp.grasping.distance_field import build_field, build_tree
from mebo_grasp.grasping.engine import BULLET, FAST, QUERY_RANGE, Engine, exact_gap, fast_contact
from mebo_grasp.grasping.hand_arrays import MOST_JOINTS, build_hand_arrays
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.hand_motion import exempt_touching_pairs
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
        exempt_touching_pairs(self._arrays)
        self._state = closing.new_state()
        self._poses = hand_motion.new_poses()
        self._field = build_field(target.mesh, target.solid_parts)
        self._rule = ClosingRule(self.settings.step, self.settings.gap_tolerance, self.settings.whole_finger)
        self._static_group = len(hand.fingers) * MOST_JOINTS
        self._tree = build_tree(np.array(target.mesh.triangles, dtype=np.float64))
        self._pose = np.eye(4)
        self._world = BulletWorld(target, self._layout.shapes, self._layout.T_group_shape, self._pose)
        kind = BULLET if self.settings.engine == "bullet" else FAST
        self._engine = Engine(kind, self._world.callback, self._pose, self._tree)

    def trial(self, T_object_tcp: Pose) -> Grasp:
        """Execute one trial.

        Args:
            T_object_tcp: pose of the hand's TCP in the object's frame.

        Returns:
            The grasp; its outcome is COLLISION if the open hand overlaps the object, NO_CONTACT if the closed
            hand does not touch it, and GRASPED otherwise.
        """
        begun = time.perf_counter()
        closed = closing.run_trial(
            self._arrays, self._field, self._engine, self._rule, self._poses, self._state, T_object_tcp.matrix
        )
        self._world.raise_pending()
        if not closed:
            return self._grasp(T_object_tcp, GraspOutcome.COLLISION, (), GraspMetrics(), begun)
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

    def _contacts(self) -> tuple[GraspContact, ...]:
        """Return a contact for each link that touches, at the final posture."""
        contacts = []
        pressing = self._pressing() if self.settings.contact_rule == "pressing" else set()
        for shape in range(len(self._layout.shapes)):
            reach = self._contact_reach(shape, shape in pressing)
            if reach <= 0.0:
                continue
            pose = self._group_pose(shape)
            lower, _ = hand_motion.gap_bounds(self._arrays, self._field, pose, shape)
            if lower > reach:
                continue
            gap, point, inward = self._closest(shape, pose)
            if gap <= reach and point is not None and inward is not None:
                normal = np.array(inward) / np.linalg.norm(inward)
                contacts.append(GraspContact(self._layout.shapes[shape].link, np.array(point), normal))
        return tuple(contacts)

    def _closest(
        self, shape: int, pose: FloatArray
    ) -> tuple[float, tuple[float, float, float] | None, tuple[float, float, float] | None]:
        """Return gap, the object's point and the direction into it, from the engine that closed the hand."""
        if self.settings.engine == "bullet" or self._layout.shapes[shape].kind not in ("capsule", "sphere"):
            return self._world.closest(shape, pose)
        points = np.empty((2, 3))
        gap = fast_contact(self._tree, self._arrays, pose, shape, QUERY_RANGE, points)
        if gap >= QUERY_RANGE:
            return gap, None, None
        on_axis, on_object = points
        x, y, z = (on_object - on_axis) / np.linalg.norm(on_object - on_axis)
        return gap, (float(on_object[0]), float(on_object[1]), float(on_object[2])), (float(x), float(y), float(z))

    def _pressing(self) -> set[int]:
        """Return the shapes that one more step of one joint would bring into the object."""
        arrays, poses, pressing = self._arrays, self._poses, set()
        for f in range(int(arrays["fingers"])):
            for j in range(arrays["joint_count"][f]):
                value = poses["joints"][f, j] + self._rule.step * arrays["speed"][f, j]
                if not arrays["lower"][f, j] <= value <= arrays["upper"][f, j]:
                    continue
                hand_motion.try_joint_value(arrays, poses, f, j, value)
                first, last = arrays["group_shapes"][[f * MOST_JOINTS + j, (f + 1) * MOST_JOINTS]]
                for shape in range(int(first), int(last)):
                    i = arrays["shape_group"][shape] % MOST_JOINTS
                    if hand_motion.gap_bounds(arrays, self._field, poses["trial"][i], shape)[0] > 0.0:
                        continue
                    if exact_gap(self._engine, arrays, self._field, poses["trial"][i], shape) <= 0.0:
                        pressing.add(shape)
        return pressing

    def _contact_reach(self, shape: int, pressing: bool) -> float:
        """Return the gap within which a shape gives a contact; 0 if it gives none."""
        if self._arrays["shape_group"][shape] == self._static_group:
            return self.settings.palm_distance if self.settings.palm_contacts else 0.0
        return QUERY_RANGE if pressing else self.settings.gap_tolerance

    def _group_pose(self, shape: int) -> FloatArray:
        pose: FloatArray = self._poses["group"][self._arrays["shape_group"][shape]]
        return pose

    def _posture(self) -> HandPosture:
        values = dict(zip(self.hand.preshape.names, self.hand.preshape.positions, strict=True))
        for f, joints in enumerate(self._layout.joints):
            for j, name in enumerate(joints):
                values[name] = float(self._poses["joints"][f, j])
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
