"""The solution set node: stores, answers with codes, follows occlusions, and survives nonsense."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import PoseArray, PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality, OcclusionArray
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet, ResetArchive
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from mebo_grasp.grasp import Pose
from mebo_grasp.nodes import qos
from mebo_grasp.solutions.frames import FrameTransform
from mebo_grasp.solutions.occlusion import Occlusion, TriangleMesh
from msg_adapters.occlusion import to_occlusion_msg
from msg_adapters.pose import to_pose_stamped_msg
from msg_adapters.transform import to_transform_stamped_msg

from .harness import Inbox, Probe, wait_until
from .scenes import OBJECT, answer, box_occlusion

pytestmark = pytest.mark.nodes

HEIGHTS = (-0.08, 0.0, 0.08)
QUALITIES = (0.3, 0.5, 0.4)


class Desk:
    """One solution set node, with what a test needs to talk to it; by the TCP rule unless told otherwise."""

    def __init__(self, launch, probe: Probe, folder: Path, **parameters) -> None:
        self.probe = probe
        parameters = {"occlusion_rule": "tcp"} | parameters
        database = str(folder / "trials.db")
        self.node = launch("solution_set_node", object=OBJECT, database=database, **parameters)
        self.best: Inbox[PoseStamped] = probe.listen(PoseStamped, "best_grasp", qos.LATCHED)
        self.set: Inbox[SolutionSetMsg] = probe.listen(SolutionSetMsg, "solution_set", qos.LATCHED)
        self._qualities = probe.publisher(GraspQuality, "grasp_quality", qos.QUALITIES)
        self.stamp = 0

    def add(self, quality: float, position=(0.0, 0.1, 0.0), **changes) -> GraspQuality:
        self.stamp += 1_000_000_000
        message = answer(to_pose_stamped_msg(self.stamp, OBJECT, Pose(np.array(position))), quality)
        for name, value in changes.items():
            setattr(message, name, value)
        self.publish(message)
        return message

    def publish(self, message: GraspQuality) -> None:
        self._qualities.publish(message)

    def ask(self, *occlusions, **fields) -> GetBestGrasp.Response:
        request = GetBestGrasp.Request(occlusions=list(occlusions), **fields)
        return self.probe.call(GetBestGrasp, "get_best_grasp", request)

    def stored(self) -> int:
        reply = self.probe.call(GetSolutionSet, "get_solution_set", GetSolutionSet.Request())
        return int(reply.solution_set.stored)


@pytest.fixture
def desk(launch, probe: Probe, tmp_path: Path) -> Desk:
    return Desk(launch, probe, tmp_path)


@pytest.fixture
def filled(desk: Desk) -> Desk:
    for height, quality in zip(HEIGHTS, QUALITIES, strict=True):
        desk.add(quality, (0.0, 0.1, height))
    wait_until(lambda: desk.stored() == 3)
    return desk


def test_an_empty_archive_says_that_nothing_is_stored(desk: Desk) -> None:
    reply = desk.ask()
    assert (reply.error_code, list(reply.grasps)) == (reply.NO_GRASP_STORED, [])
    assert reply.message
    reply = desk.probe.call(GetSolutionSet, "get_solution_set", GetSolutionSet.Request())
    assert reply.error_code == reply.NO_GRASP_STORED


def test_a_second_trial_of_one_stamp_is_refused_with_a_word_a_repeated_one_without(desk: Desk) -> None:
    first = desk.add(0.3)
    wait_until(lambda: desk.stored() == 1)
    desk.publish(first)
    desk.publish(answer(to_pose_stamped_msg(desk.stamp, OBJECT, Pose(np.array([0.1, 0.0, 0.0]))), 0.9))
    wait_until(lambda: f"another trial has the stamp {desk.stamp} ns already" in desk.node.log)
    assert desk.node.log.count("another trial has the stamp") == 1
    assert [grasp.quality for grasp in desk.ask().grasps] == [0.3]


def test_occlusions_of_the_request_filter_the_best(filled: Desk) -> None:
    assert filled.ask().grasps[0].quality == 0.5
    middle = box_occlusion((0.0, 0.1, 0.0), (0.05, 0.05, 0.05))
    reply = filled.ask(middle)
    assert [grasp.quality for grasp in reply.grasps] == [0.4]
    assert reply.occluded == 1
    everything = box_occlusion((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), name="wall")
    reply = filled.ask(everything)
    assert (reply.error_code, reply.considered, reply.occluded) == (reply.ALL_OCCLUDED, 3, 3)
    assert "wall" in reply.message
    assert (list(reply.blocked_by), list(reply.blocked)) == (["wall"], [3])
    assert [g.quality for g in filled.ask(max_grasps=10).grasps] == [0.5, 0.4, 0.3]
    assert [g.quality for g in filled.ask(max_grasps=10, min_quality=0.35).grasps] == [0.5, 0.4]
    assert [g.quality for g in filled.ask(max_grasps=10, min_diversity=0.1).grasps] == [0.5]


def test_the_best_may_be_asked_for_by_what_is_known_under_noise(filled: Desk) -> None:
    for expected, worst in ((0.35, 0.1), (0.3, 0.2)):
        filled.add(0.2, expected_quality=expected, quality_sd=0.05, worst_quality=worst, noise_samples=8)
    wait_until(lambda: filled.stored() == 5)
    reply = filled.ask(ranking=GetBestGrasp.Request.RANK_EXPECTED, max_grasps=10)
    assert [g.expected_quality for g in reply.grasps] == [0.35, 0.3]
    assert (reply.error_code, reply.considered, reply.passed_over) == (reply.NONE, 2, 3)
    assert "3 grasps were passed over" in reply.message
    reply = filled.ask(ranking=GetBestGrasp.Request.RANK_WORST)
    assert [(g.worst_quality, g.quality_sd, g.noise_samples) for g in reply.grasps] == [(0.2, 0.05, 8)]
    for quantile, figure in ((0.0, 0.35 - 1.645 * 0.05), (0.5, 0.35)):
        for limit, expected_count in ((figure - 1e-3, 1), (figure + 1e-3, 0)):
            reply = filled.ask(ranking=GetBestGrasp.Request.RANK_QUANTILE, quantile=quantile, min_quality=limit)
            assert len(reply.grasps) == expected_count
    assert reply.error_code == reply.NO_GRASP_STORED
    reply = filled.ask()
    assert (reply.grasps[0].quality, reply.passed_over, reply.message) == (0.5, 0, "")


def test_occlusions_of_the_topic_are_known_until_ignored(filled: Desk) -> None:
    occlusions = filled.probe.publisher(OcclusionArray, "occlusions", qos.LATCHED)
    seen = len(filled.best.messages)
    occlusions.publish(OcclusionArray(occlusions=[box_occlusion((0.0, 0.1, 0.0), (0.05, 0.05, 0.05))]))
    assert filled.best.wait_for(lambda m: m.pose.position.z == 0.08, after=seen)
    filled.set.wait_for(lambda m: [g.quality for g in m.grasps] == [0.4, 0.3])
    assert filled.ask().grasps[0].quality == 0.4
    assert filled.ask(ignore_known=True).grasps[0].quality == 0.5
    seen = len(filled.best.messages)
    occlusions.publish(OcclusionArray(occlusions=[box_occlusion((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))]))
    assert math.isnan(filled.best.wait_for(after=seen).pose.position.x)
    occlusions.publish(OcclusionArray())
    assert filled.best.wait_for(lambda m: m.pose.position.z == 0.0, after=seen + 1)


AT_THE_FINGERTIPS = (0.08, 0.1, 0.011)
"""Of a left iCub hand whose TCP is at (0, 0.1, 0), turned like the object; 8 cm from the TCP."""
ON_THE_WAY = (-0.064, 0.1, 0.064)
"""9 cm before that TCP against the approach axis, beside the hand."""


def test_the_hand_and_its_approach_count_by_the_hand_rule_and_the_tcp_alone_by_the_thesiss(
    launch, probe: Probe, tmp_path: Path
) -> None:
    desk = Desk(launch, probe, tmp_path, occlusion_rule="hand", approach_length=0.1)
    desk.add(0.5, hand="icub_left")
    desk.best.wait_for()
    rules = GetBestGrasp.Request
    for place, size in ((AT_THE_FINGERTIPS, 0.01), (ON_THE_WAY, 0.01)):
        thing = box_occlusion(place, (size, size, size), name="cup")
        for rule in (rules.RULE_OF_NODE, rules.RULE_HAND):
            reply = desk.ask(thing, rule=rule)
            assert (reply.error_code, list(reply.blocked_by)) == (reply.ALL_OCCLUDED, ["cup"])
        assert desk.ask(thing, rule=rules.RULE_TCP).error_code == reply.NONE
    beside = box_occlusion((0.0, 0.3, 0.0), (0.01, 0.01, 0.01))
    assert desk.ask(beside).error_code == reply.NONE
    beside.margin = 0.2
    assert desk.ask(beside).error_code == reply.ALL_OCCLUDED


def test_parameters_say_how_long_and_along_what_the_hand_arrives_and_the_margin(
    launch, probe: Probe, tmp_path: Path
) -> None:
    desk = Desk(
        launch, probe, tmp_path,
        occlusion_rule="hand", approach_length=0.3, approach_axis=[0.0, -1.0, 0.0], occlusion_margin=0.02,
    )  # fmt: skip
    desk.add(0.5, hand="icub_left")
    desk.best.wait_for()
    assert desk.ask(box_occlusion(ON_THE_WAY, (0.01, 0.01, 0.01))).error_code == 0
    behind = box_occlusion((0.0, 0.39, 0.0), (0.01, 0.01, 0.01))
    assert desk.ask(behind).error_code == GetBestGrasp.Response.ALL_OCCLUDED
    assert desk.ask(box_occlusion((0.0, 0.415, 0.0), (0.01, 0.01, 0.01))).error_code == (
        GetBestGrasp.Response.ALL_OCCLUDED
    )
    assert desk.ask(box_occlusion((0.0, 0.43, 0.0), (0.01, 0.01, 0.01))).error_code == 0


def test_an_unknown_hand_is_named_and_the_parameters_hand_stands_in(launch, probe: Probe, tmp_path: Path) -> None:
    desk = Desk(launch, probe, tmp_path, occlusion_rule="hand")
    desk.add(0.5, hand="claw")
    desk.node.wait_for_log("'claw'")
    assert desk.ask(box_occlusion(AT_THE_FINGERTIPS, (0.01, 0.01, 0.01))).occluded == 1


def test_static_transforms_lead_occlusions_of_other_frames_to_the_object(launch, probe: Probe, tmp_path: Path) -> None:
    transforms = ["world bottle 1 0 0 0 0 0 1", "world camera 1 0 0.5 0 0 0 1"]
    desk = Desk(launch, probe, tmp_path, static_transforms=transforms)
    for height, quality in zip(HEIGHTS, QUALITIES, strict=True):
        desk.add(quality, (0.0, 0.1, height))
    wait_until(lambda: desk.stored() == 3)
    seen = box_occlusion((0.0, 0.1, -0.5), (0.05, 0.05, 0.05), frame="camera")
    assert [g.quality for g in desk.ask(seen, max_grasps=3).grasps] == [0.4, 0.3]
    elsewhere = box_occlusion((0.0, 0.1, -0.5), (0.05, 0.05, 0.05), frame="kitchen")
    assert desk.ask(elsewhere).error_code == GetBestGrasp.Response.WRONG_FRAME
    place = FrameTransform("kitchen", "camera", Pose(np.array([0.0, 0.0, 0.08])))
    elsewhere.transforms = [to_transform_stamped_msg(place)]
    assert [g.quality for g in desk.ask(elsewhere, max_grasps=3).grasps] == [0.5, 0.4]


def test_a_mesh_blocks_over_ros(filled: Desk) -> None:
    cube = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh = TriangleMesh(np.array(cube.vertices), np.array(cube.faces))
    occlusion = Occlusion("cube", mesh, Pose(np.array([0.0, 0.1, 0.0])))
    reply = filled.ask(to_occlusion_msg(occlusion, OBJECT))
    assert ([g.quality for g in reply.grasps], list(reply.blocked_by)) == ([0.4], ["cube"])


def test_poses_of_the_set_are_published_for_rviz(filled: Desk) -> None:
    poses: Inbox[PoseArray] = filled.probe.listen(PoseArray, "solution_poses", qos.LATCHED)
    array = poses.wait_for(lambda m: len(m.poses) == 3)
    assert array.header.frame_id == OBJECT
    assert [pose.position.z for pose in array.poses] == [0.0, 0.08, -0.08]


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"occlusion_rule": "guess"}, "guess"),
        ({"static_transforms": ["world bottle 1 2"]}, "world bottle 1 2"),
        ({"symmetry_axis": [0.0, 0.0, 0.0]}, "symmetry_axis"),
        ({"approach_axis": [1.0]}, "approach_axis"),
        ({"hand": "claw"}, "claw"),
        ({"approach_length": -0.1}, "approach_length"),
    ],
)
def test_parameters_that_cannot_work_end_the_node_by_name(
    launch, tmp_path: Path, parameters: dict[str, object], expected: str
) -> None:
    node = launch("solution_set_node", database=str(tmp_path / "trials.db"), **parameters)
    assert node.process.wait(60.0) == 2
    assert expected in node.log
    assert not (tmp_path / "trials.db").exists()


def test_grasps_of_a_symmetric_object_are_not_diverse_by_a_turn(launch, probe: Probe, tmp_path: Path) -> None:
    desk = Desk(launch, probe, tmp_path, symmetry_axis=[0.0, 0.0, 2.0], rotation_weight=0.0)
    desk.add(0.5, (0.0, 0.1, 0.0))
    desk.add(0.4, (0.1, 0.0, 0.0))
    desk.add(0.3, (0.1, 0.0, 0.1))
    wait_until(lambda: desk.stored() == 3)
    assert [g.quality for g in desk.ask(max_grasps=3, min_diversity=0.05).grasps] == [0.5, 0.3]


def bad_occlusions() -> list[OcclusionMsg]:
    wrong_frame = box_occlusion((0, 0, 0), (1, 1, 1), frame="kitchen")
    negative = box_occlusion((0, 0, 0), (-1, 1, 1))
    too_few = box_occlusion((0, 0, 0), (1, 1, 1))
    too_few.shape.dimensions = [1.0]
    nan = box_occlusion((math.nan, 0, 0), (1, 1, 1))
    unknown = box_occlusion((0, 0, 0), (1, 1, 1))
    unknown.shape.type = SolidPrimitive.PRISM
    no_rotation = box_occlusion((0, 0, 0), (1, 1, 1))
    no_rotation.pose.orientation.w = 0.0
    return [wrong_frame, negative, too_few, nan, unknown, no_rotation]


def test_bad_requests_get_a_code_and_the_node_goes_on(filled: Desk) -> None:
    wrong_frame, *others = bad_occlusions()
    reply = filled.ask(wrong_frame)
    assert reply.error_code == reply.WRONG_FRAME
    assert "kitchen" in reply.message
    assert OBJECT in reply.message
    for occlusion in others:
        reply = filled.ask(occlusion)
        assert (reply.error_code, list(reply.grasps)) == (reply.INVALID_REQUEST, [])
        assert reply.message
    bad_numbers = ({"min_quality": math.nan}, {"min_quality": -1.0}, {"min_diversity": math.inf}, {"rule": 9})
    for fields in (*bad_numbers, {"ranking": 9}, {"quantile": 0.7}, {"max_grasps": 10_001}):
        reply = filled.ask(**fields)
        assert reply.error_code == reply.INVALID_REQUEST
    for fields in ({"size": 2**32 - 1}, {"min_diversity": -0.1}, {"min_diversity": math.nan}):
        request = GetSolutionSet.Request(**fields)
        reply = filled.probe.call(GetSolutionSet, "get_solution_set", request)
        assert (reply.error_code, list(reply.solution_set.grasps)) == (reply.INVALID_REQUEST, [])
        assert next(iter(fields)) in reply.message
    assert filled.ask().grasps[0].quality == 0.5


def test_a_bad_occlusion_on_the_topic_leaves_the_known_ones(filled: Desk) -> None:
    occlusions = filled.probe.publisher(OcclusionArray, "occlusions", qos.LATCHED)
    occlusions.publish(OcclusionArray(occlusions=[box_occlusion((0.0, 0.1, 0.0), (0.05, 0.05, 0.05))]))
    filled.best.wait_for(lambda m: m.pose.position.z == 0.08)
    occlusions.publish(OcclusionArray(occlusions=[bad_occlusions()[0]]))
    filled.node.wait_for_log("kitchen")
    assert filled.ask().grasps[0].quality == 0.4


def test_unusable_qualities_are_not_stored_and_repeated_ones_once(desk: Desk) -> None:
    desk.add(math.nan)
    desk.add(0.9, outcome=99)
    desk.add(math.inf)
    desk.add(0.8, object_id="another")
    desk.add(0.7, header=Header(frame_id=OBJECT))  # a stamp of 0, as a hand that forgets the header sends it
    good = desk.add(0.2)
    desk.publish(good)
    failed = desk.add(math.nan, outcome=GraspQuality.FAILED)
    assert failed.outcome == GraspQuality.FAILED
    wait_until(lambda: desk.stored() == 2)
    reply = desk.ask(max_grasps=10)
    assert [grasp.quality for grasp in reply.grasps] == [0.2]


def test_reset_wants_the_name_of_the_object(filled: Desk) -> None:
    service = "/solution_set_node/reset"
    refused = filled.probe.call(ResetArchive, service, ResetArchive.Request(object_id="mug"))
    assert (refused.error_code, refused.deleted) == (refused.WRONG_OBJECT, 0)
    assert filled.stored() == 3
    done = filled.probe.call(ResetArchive, service, ResetArchive.Request(object_id=OBJECT))
    assert (done.error_code, done.deleted) == (done.NONE, 3)
    assert filled.stored() == 0


def test_a_database_that_is_none_ends_the_node_and_stays_as_it_is(launch, tmp_path: Path) -> None:
    path = tmp_path / "holiday.db"
    path.write_bytes(b"these are my holiday pictures" * 100)
    node = launch("solution_set_node", database=str(path))
    assert node.process.wait(30.0) == 2
    assert "holiday.db" in node.log
    assert path.read_bytes() == b"these are my holiday pictures" * 100
