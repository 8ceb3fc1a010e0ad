"""Space ``pose_posture`` over ROS: candidates of two messages, and what becomes of half a candidate."""

from __future__ import annotations

from functools import partial

import pytest
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mebo_grasp.grasp import HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings
from mebo_grasp.nodes import qos
from msg_adapters.grasp import from_joint_state_msg, to_joint_state_msg
from msg_adapters.pose import from_pose_stamped_msg, to_pose_stamped_msg
from msg_adapters.time import from_time_msg

from .harness import Probe, wait_until
from .scenes import OBJECT

pytestmark = pytest.mark.nodes

BUDGET = 9


def has_stamp(stamp_ns: int, message: GraspQuality) -> bool:
    return from_time_msg(message.header.stamp) == stamp_ns


def test_postures_reach_the_hand_and_half_a_candidate_is_answered_as_failed(launch, probe: Probe) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    poses = probe.listen(PoseStamped, "candidate_pose", qos.CANDIDATES)
    postures = probe.listen(JointState, "candidate_posture", qos.CANDIDATES)
    status = probe.listen(ExplorationStatus, "exploration_status", qos.LATCHED)
    launch("hand_node", object=OBJECT, engine="fast", expects_posture=True, posture_timeout=0.5)
    launch("optimizer_node", object=OBJECT, space="pose_posture", synergies=3, budget=BUDGET, initial_points=BUDGET,
           autostart=False)  # fmt: skip
    # Candidates are not repeated for whoever comes late: the probe must be known before the first one.
    wait_until(lambda: all(probe.node.count_publishers(f"candidate_{half}") for half in ("pose", "posture")))
    assert probe.call(Trigger, "optimizer_node/start", Trigger.Request()).success
    final = status.wait_for(lambda message: message.state == ExplorationStatus.FINISHED)
    assert (final.evaluations, final.failed) == (BUDGET, 0)

    answers = qualities.wait_for_count(BUDGET)
    sent = {from_time_msg(m.header.stamp): m for m in postures.wait_for_count(BUDGET)}
    asked = {from_time_msg(m.header.stamp): m for m in poses.wait_for_count(BUDGET)}
    settings, hand = TrialSettings(engine="fast"), HandModel.load("icub_left")
    with GraspSimulator(TargetObject.builtin(OBJECT), hand, settings) as simulator:
        for got in answers:
            stamp = from_time_msg(got.header.stamp)
            pose, posture = from_pose_stamped_msg(asked[stamp], OBJECT), from_joint_state_msg(sent[stamp])
            assert posture != hand.preshape
            expected = simulator.trial(pose, posture)
            assert (got.outcome, got.quality) == (int(expected.outcome), expected.quality)
            assert list(got.hand_posture.position) == list(expected.hand_posture.positions)

    to_hand = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    posture_to_hand = probe.publisher(JointState, "candidate_posture", qos.CANDIDATES)
    place, preshape = Pose.from_rpy([0.0, 0.3, 0.0], [0.0, 0.0, 0.0]), hand.preshape
    alien = HandPosture(("tail_joint",), (0.1,))
    uneven = to_joint_state_msg(preshape, 4)
    uneven.position.append(0.0)
    to_hand.publish(to_pose_stamped_msg(1, OBJECT, place))
    posture_to_hand.publish(to_joint_state_msg(preshape, 2))
    for stamp, message in ((3, to_joint_state_msg(alien, 3)), (4, uneven), (5, to_joint_state_msg(preshape, 5))):
        to_hand.publish(to_pose_stamped_msg(stamp, OBJECT, place))
        posture_to_hand.publish(message)
    expected_text = {1: "no candidate_posture", 2: "no candidate_pose", 3: "tail_joint", 4: "position", 5: ""}
    for stamp, text in expected_text.items():
        reply = qualities.wait_for(partial(has_stamp, stamp))
        assert reply.outcome == (GraspQuality.FAILED if text else GraspQuality.NO_CONTACT), stamp
        assert text in reply.message
