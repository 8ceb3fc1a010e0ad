"""The hand node: every candidate is answered, whatever it is."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality
from visualization_msgs.msg import MarkerArray

from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.robustness import perturb_pose
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes import qos
from msg_adapters.pose import to_pose_stamped_msg

from .harness import Probe
from .scenes import OBJECT

pytestmark = pytest.mark.nodes


@pytest.fixture
def middle() -> Pose:
    """The middle of the search space over the bottle."""
    space = position_space(TargetObject.builtin(OBJECT), HandModel.load("icub_left"))
    return space.to_pose((space.lower + space.upper) / 2.0)


def test_answers_as_the_simulator_does_and_twice_the_same(launch, probe: Probe, middle: Pose) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    launch("hand_node", object=OBJECT)
    candidates = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    for stamp in (1_000_000_007, 2_000_000_009):
        candidates.publish(to_pose_stamped_msg(stamp, OBJECT, middle))
    first, second = qualities.wait_for_count(2)
    with GraspSimulator(TargetObject.builtin(OBJECT), HandModel.load("icub_left")) as simulator:
        expected = simulator.trial(middle)
    assert (first.outcome, first.quality) == (int(expected.outcome), expected.quality)
    assert (first.epsilon, first.volume, first.isotropy) == (
        expected.epsilon,
        expected.volume,
        expected.isotropy,
    )
    assert list(first.hand_posture.position) == list(expected.hand_posture.positions)
    assert len(first.contacts) == len(expected.contacts)
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (1, 7)
    assert (second.header.stamp.sec, second.header.stamp.nanosec) == (2, 9)
    assert (first.quality, first.contacts) == (second.quality, second.contacts)


def stamped(second: int, quality: GraspQuality) -> bool:
    return bool(quality.header.stamp.sec == second)


def bad_candidates() -> list[tuple[str, PoseStamped, str]]:
    cases = []
    names = ("nan", "finite"), ("zero quaternion", "norm"), ("frame", "kitchen"), ("stamp", "sec=-5"), ("far", "")
    for second, (name, expected) in enumerate(names, start=1):
        message = to_pose_stamped_msg(second * 10**9, OBJECT, Pose.from_rpy([0.0, 0.1, 0.0], [0.0, 0.0, 0.0]))
        if name == "nan":
            message.pose.position.y = math.nan
        elif name == "zero quaternion":
            message.pose.orientation.w = 0.0
        elif name == "frame":
            message.header.frame_id = "kitchen"
        elif name == "stamp":
            message.header.stamp.sec = -5
        else:
            message.pose.position.x = 1e6
        cases.append((name, message, expected))
    return cases


def test_bad_candidates_are_answered_and_the_next_good_one_is_tried(launch, probe: Probe, middle: Pose) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    launch("hand_node", object=OBJECT)
    candidates = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    cases = bad_candidates()
    for _, message, _ in cases:
        candidates.publish(message)
    candidates.publish(to_pose_stamped_msg(99_000_000_000, OBJECT, middle))
    answers = qualities.wait_for_count(len(cases) + 1)
    for (name, sent, expected), got in zip(cases, answers, strict=False):
        assert got.header == sent.header, name
        if name == "far":
            assert (got.outcome, got.quality) == (GraspQuality.NO_CONTACT, 0.0)
        else:
            assert got.outcome == GraspQuality.FAILED
            assert math.isnan(got.quality)
            assert expected in got.message
    assert answers[-1].outcome in (GraspQuality.GRASPED, GraspQuality.COLLISION, GraspQuality.NO_CONTACT)
    assert answers[-1].header.stamp.sec == 99


def test_a_candidate_without_a_stamp_is_given_one(launch, probe: Probe, middle: Pose) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    launch("hand_node", object=OBJECT)
    candidates = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    candidates.publish(to_pose_stamped_msg(0, OBJECT, middle))
    candidates.publish(to_pose_stamped_msg(0, OBJECT, middle))
    first, second = (message.header.stamp for message in qualities.wait_for_count(2))
    assert first.sec > 0
    assert (second.sec, second.nanosec) > (first.sec, first.nanosec)


def test_without_a_rate_no_markers_are_published(launch, probe: Probe, middle: Pose) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    shown = probe.listen(MarkerArray, "hand_markers", qos.LATCHED)
    launch("hand_node", object=OBJECT, marker_rate=0.0)
    candidates = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    for stamp in range(1, 11):
        candidates.publish(to_pose_stamped_msg(stamp, OBJECT, middle))
    assert qualities.wait_for_count(10)[0].hand_posture.name
    assert shown.messages == []


def test_an_inexact_hand_answers_with_the_commanded_pose_and_what_repeating_gives(
    launch, probe: Probe, middle: Pose
) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    launch("hand_node", object=OBJECT, position_noise=0.003, rotation_noise=0.02, noise_seed=4, repetitions=2)
    candidates = probe.publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
    sent = [to_pose_stamped_msg(second * 10**9, OBJECT, middle) for second in (1, 2)]
    for message in sent:
        candidates.publish(message)
    answers, rng = qualities.wait_for_count(2), np.random.default_rng(4)
    with GraspSimulator(TargetObject.builtin(OBJECT), HandModel.load("icub_left")) as simulator:
        for answer, message in zip(answers, sent, strict=True):
            assert answer.tcp_pose == message.pose
            executed, *further = (simulator.trial(perturb_pose(middle, 0.003, 0.02, rng)) for _ in range(3))
            assert list(answer.hand_posture.position) == list(executed.hand_posture.positions)
            assert executed.quality > 0.0
            assert answer.noise_samples == 2
            assert answer.expected_quality == pytest.approx(np.mean([grasp.quality for grasp in further]))
            assert answer.worst_quality == min(grasp.quality for grasp in further)
    assert answers[0].hand_posture != answers[1].hand_posture


def test_two_hands_have_topics_of_their_own(launch, probe: Probe, middle: Pose) -> None:
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    launch("hand_node", object=OBJECT, hand_namespace="left")
    launch("hand_node", object=OBJECT, hand_namespace="other", hand="icub_right")
    for second, namespace in enumerate(("left", "other"), start=1):
        candidates = probe.publisher(PoseStamped, f"{namespace}/candidate_pose", qos.CANDIDATES)
        candidates.publish(to_pose_stamped_msg(second * 1_000_000_000, OBJECT, middle))
        assert qualities.wait_for(partial(stamped, second)).hand
    assert {quality.hand for quality in qualities.messages} == {"icub_left", "icub_right"}


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"object": "unicorn"}, "unicorn"),
        ({"hand": "claw"}, "claw"),
        ({"friction": -0.5}, "friction"),
        ({"cone_edges": 2}, "cone_edges"),
        ({"object_scale": 0.0}, "object_scale"),
    ],
)
def test_bad_parameters_end_the_node_with_one_clear_line(launch, parameters, expected) -> None:
    node = launch("hand_node", **parameters)
    assert node.process.wait(30.0) == 2
    assert expected in node.log
