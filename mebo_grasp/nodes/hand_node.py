"""``hand_node``: tries candidate poses with a simulated hand and publishes how good each grasp is.

With ``expects_posture`` a candidate is a pose and the posture in which the hand arrives, two messages of one stamp.
"""

from __future__ import annotations

import time
from typing import cast

import numpy as np
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from mebo_grasp.errors import InvalidHandError, InvalidMessageError, MeboGraspError
from mebo_grasp.grasp import Grasp, Pose, StampedGrasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.robustness import ExecutionNoise, InexactHand
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import ConcaveShape, TargetObject
from mebo_grasp.grasping.trial import ContactModel, EngineName, QualityName, TrialSettings
from mebo_grasp.nodes import markers, qos
from mebo_grasp.nodes.candidate_pairs import CandidatePairs
from mebo_grasp.nodes.clock import StampSource, random_offset
from mebo_grasp.nodes.parameters import declare
from mebo_grasp.nodes.runtime import guarded, may_be_broken_off, run_node
from mebo_grasp.nodes.settings import HandNodeSettings
from msg_adapters.grasp import from_joint_state_msg, to_grasp_quality_msg, to_joint_state_msg
from msg_adapters.pose import from_pose_stamped_msg
from msg_adapters.time import from_time_msg, to_time_msg


class HandNode(Node):
    """Subscribes to candidates; publishes ``grasp_quality``, ``joint_states`` and markers.

    Raises:
        MeboGraspError: a parameter, the object or the hand description is not usable.
    """

    def __init__(self) -> None:
        super().__init__("hand_node")
        settings = declare(self, HandNodeSettings)
        self._target = TargetObject.load(
            settings.object, settings.object_scale, cast(ConcaveShape, settings.object_concave)
        )
        self._hand = HandModel.load(settings.hand)
        self._simulator = GraspSimulator(
            self._target,
            self._hand,
            TrialSettings(
                friction=settings.friction,
                cone_edges=settings.cone_edges,
                contact_model=cast(ContactModel, settings.contact_model),
                quality=cast(QualityName, settings.quality),
                engine=cast(EngineName, settings.engine),
            ),
        )
        noise = ExecutionNoise(
            position=settings.position_noise,
            rotation=settings.rotation_noise,
            friction=settings.friction_noise,
            normal=settings.normal_noise,
        )
        self._robot = InexactHand(
            self._simulator, noise, np.random.default_rng(settings.noise_seed), settings.repetitions
        )
        self._next_stamp = StampSource(lambda: self.get_clock().now().nanoseconds, offset_ns=random_offset())
        self._marker_period = 1.0 / settings.marker_rate if settings.marker_rate > 0 else float("inf")
        self._markers_due = 0.0 if settings.marker_rate > 0 else float("inf")
        self._warm_up()
        self._posture_timeout = settings.posture_timeout
        self._pairs: CandidatePairs[PoseStamped, JointState] | None = None
        if settings.expects_posture:
            self._pairs = CandidatePairs(settings.posture_timeout)
            self.create_timer(settings.posture_timeout / 4.0, self._give_up_halves)
        self._advertise(settings.hand_namespace)
        self.get_logger().info(
            f"hand '{self._hand.name}' is ready to grasp '{self._target.object_id}' "
            f"({' x '.join(f'{1000 * side:.0f}' for side in self._target.extents)} mm); "
            f"candidates are expected in frame '{self._target.object_id}'"
        )

    def _warm_up(self) -> None:
        # What compiles or is built at its first use does so before the first candidate can come: later it
        # would look like a silent hand.
        self.get_logger().info("preparing; a first start compiles, which takes minutes")
        start = time.perf_counter()
        space = position_space(self._target, self._hand)
        with may_be_broken_off():
            self._simulator.trial(space.to_pose((space.lower + space.upper) / 2.0))
        seconds = time.perf_counter() - start
        if seconds > 1.0:
            self.get_logger().info(f"prepared '{self._target.object_id}' in {seconds:.1f} s")

    def _advertise(self, hand_namespace: str) -> None:
        prefix = f"{hand_namespace}/" if hand_namespace else ""
        self._joints = self.create_publisher(JointState, f"{prefix}joint_states", qos.LATCHED)
        self._hand_markers = self.create_publisher(MarkerArray, f"{prefix}hand_markers", qos.LATCHED)
        object_markers = self.create_publisher(MarkerArray, f"{prefix}object_markers", qos.LATCHED)
        object_markers.publish(markers.object_markers(self._target))
        description = self.create_publisher(String, f"{prefix}robot_description", qos.LATCHED)
        description.publish(String(data=self._hand.urdf_path.read_text(encoding="utf-8")))
        self.create_subscription(PoseStamped, f"{prefix}candidate_pose", self._on_candidate, qos.CANDIDATES)
        if self._pairs is not None:
            self.create_subscription(JointState, f"{prefix}candidate_posture", self._on_posture, qos.CANDIDATES)
        # Last: by it an optimizer knows that somebody answers.
        self._qualities = self.create_publisher(GraspQuality, "grasp_quality", qos.QUALITIES)

    @guarded
    def _on_candidate(self, candidate: PoseStamped) -> None:
        try:
            stamp_ns = from_time_msg(candidate.header.stamp)
        except InvalidMessageError as error:
            self._refuse_stamp(candidate, str(error))
            return
        if self._pairs is None:
            self._answer(candidate.header, self._try_candidate(candidate))
            return
        pair = self._pairs.add_pose(stamp_ns, candidate, time.monotonic())
        if pair is not None:
            self._answer(candidate.header, self._try_candidate(*pair))

    @guarded
    def _on_posture(self, posture: JointState) -> None:
        assert self._pairs is not None
        pair = self._pairs.add_posture(from_time_msg(posture.header.stamp), posture, time.monotonic())
        if pair is not None:
            self._answer(pair[0].header, self._try_candidate(*pair))

    @guarded
    def _give_up_halves(self) -> None:
        assert self._pairs is not None
        for stamp_ns, half in self._pairs.give_up(time.monotonic()).items():
            came, missing = ("pose", "posture") if half.pose is not None else ("posture", "pose")
            reason = (
                f"no candidate_{missing} came within {self._posture_timeout:g} s of the candidate_{came} with stamp "
                f"{stamp_ns} ns; this hand expects both with one stamp (expects_posture)"
            )
            self.get_logger().warning(f"candidate refused: {reason}")
            header = half.pose.header if half.pose is not None else Header(stamp=to_time_msg(stamp_ns))
            header.frame_id = header.frame_id or self._target.object_id
            self._answer(header, self._refused(half.pose, reason))

    def _refused(self, candidate: PoseStamped | None, reason: str) -> Grasp:
        try:
            pose = Pose.identity() if candidate is None else from_pose_stamped_msg(candidate, self._target.object_id)
        except MeboGraspError:
            pose = Pose.identity()
        return Grasp.failed(pose, reason, self._target.object_id, self._hand.name)

    def _answer(self, header: Header, grasp: Grasp) -> None:
        # The header goes back as it came; only a stamp of zero, as typed by hand, is given an identity.
        stamp_ns = from_time_msg(header.stamp) or self._next_stamp()
        self._qualities.publish(to_grasp_quality_msg(StampedGrasp(stamp_ns, grasp), header.frame_id))
        if grasp.hand_posture.names:
            self._joints.publish(to_joint_state_msg(grasp.hand_posture, stamp_ns))
        self._show(grasp)

    def _refuse_stamp(self, candidate: PoseStamped, reason: str) -> None:
        self.get_logger().warning(f"candidate refused: {reason}")
        quality = to_grasp_quality_msg(StampedGrasp(0, self._refused(candidate, reason)), candidate.header.frame_id)
        # Not a time, yet by it who asked knows the answer: it goes back as it came.
        quality.header.stamp = candidate.header.stamp
        self._qualities.publish(quality)

    def _try_candidate(self, candidate: PoseStamped, posture: JointState | None = None) -> Grasp:
        object_id, hand = self._target.object_id, self._hand.name
        try:
            T_object_tcp = from_pose_stamped_msg(candidate, expected_frame=object_id)
            preshape = None if posture is None else from_joint_state_msg(posture)
        except MeboGraspError as error:
            self.get_logger().warning(f"candidate refused: {error}")
            return Grasp.failed(Pose.identity(), str(error), object_id, hand)
        try:
            return self._robot.trial(T_object_tcp, preshape)
        except InvalidHandError as error:
            self.get_logger().warning(f"candidate refused: {error}")
            return Grasp.failed(T_object_tcp, str(error), object_id, hand)
        except Exception as error:
            # The optimizer must hear of every trial, also of one that breaks the simulator.
            message = f"{type(error).__name__}: {error}"
            self.get_logger().error(f"trial failed: {message}")
            return Grasp.failed(T_object_tcp, message, object_id, hand)

    def _show(self, grasp: Grasp) -> None:
        now = time.monotonic()
        if now < self._markers_due or not grasp.hand_posture.names:
            return
        self._markers_due = now + self._marker_period
        self._hand_markers.publish(markers.grasp_markers([grasp], self._target.object_id, self._hand))

    def destroy_node(self) -> None:
        """Stop the simulator, then the node."""
        self._simulator.close()
        super().destroy_node()


def main() -> None:
    """Run the node until it is stopped."""
    run_node(HandNode)


if __name__ == "__main__":
    main()
