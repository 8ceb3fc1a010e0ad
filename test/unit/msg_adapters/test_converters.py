"""What the converters refuse, and with which words."""

import math
from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Vector3
from mebo_grasp_interfaces.msg import GraspQuality
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from shape_msgs.msg import Mesh as MeshMsg
from shape_msgs.msg import SolidPrimitive

from mebo_grasp.errors import (
    InvalidMessageError,
    InvalidOcclusionError,
    InvalidPoseError,
    InvalidQualityError,
    WrongFrameError,
)
from mebo_grasp.grasp import (
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    Pose,
    QualityUnderNoise,
    StampedGrasp,
)
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.frames import FrameTransform, FrameTree
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Sphere,
    TriangleMesh,
)
from mebo_grasp.solutions.solution_set import SolutionSet
from msg_adapters.grasp import from_grasp_quality_msg, to_grasp_quality_msg, to_joint_state_msg
from msg_adapters.occlusion import (
    from_mesh_msg,
    from_occlusion_array_msg,
    from_occlusion_msg,
    from_occlusion_msgs,
    to_mesh_msg,
    to_occlusion_array_msg,
    to_occlusion_msg,
)
from msg_adapters.pose import from_pose_stamped_msg, to_pose_array_msg, to_pose_stamped_msg
from msg_adapters.solution_set import from_solution_set_msg, to_solution_set_msg
from msg_adapters.time import from_duration_msg, from_time_msg, to_duration_msg, to_time_msg
from msg_adapters.transform import from_transform_stamped_msg, to_transform_stamped_msg

GRASP = Grasp(
    Pose.from_rpy([0.01, -0.02, 0.1], [0.1, 0.2, 0.3]),
    GraspOutcome.GRASPED,
    0.4,
    epsilon=0.4,
    volume=0.02,
    isotropy=0.3,
    force_closure=True,
    contacts=(GraspContact("thumb_3", np.array([0.01, 0.0, 0.1]), np.array([0.0, 0.6, 0.8])),),
    hand_posture=HandPosture(("thumb_0", "thumb_1"), (1.3, -0.2)),
    object_id="bottle",
    hand="icub_right",
    computation_time=0.0125,
)


def quality_msg(**changes: object) -> GraspQuality:
    message = to_grasp_quality_msg(StampedGrasp(12_000_000_034, GRASP), "bottle")
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_the_numbers_of_a_grasp_stand_in_their_fields() -> None:
    message = quality_msg()
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)
    assert message.header.frame_id == message.object_id == "bottle"
    assert message.outcome == GraspQuality.GRASPED
    assert message.tcp_pose.position.z == 0.1
    assert list(message.hand_posture.position) == [1.3, -0.2]
    assert message.contacts[0].normal.z == 0.8
    assert (message.computation_time.sec, message.computation_time.nanosec) == (0, 12_500_000)


def test_outcomes_have_the_same_numbers_in_messages_and_values() -> None:
    for outcome in GraspOutcome:
        assert getattr(GraspQuality, outcome.name) == outcome.value


def test_a_failed_trial_is_nan_and_says_why() -> None:
    failed = StampedGrasp(5, Grasp.failed(Pose.identity(), "no answer", "bottle"))
    message = to_grasp_quality_msg(failed, "bottle")
    assert math.isnan(message.quality)
    assert message.message == "no answer"
    assert from_grasp_quality_msg(message, "bottle").grasp.outcome is GraspOutcome.FAILED


@pytest.mark.parametrize("name", ["quality", "epsilon", "volume", "isotropy"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_is_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidMessageError, match=f"{name} of a trial with outcome GRASPED"):
        from_grasp_quality_msg(quality_msg(**{name: value}), "bottle")


def test_a_failed_trial_with_a_value_is_refused() -> None:
    with pytest.raises(InvalidMessageError, match="must be NaN"):
        from_grasp_quality_msg(quality_msg(outcome=GraspQuality.FAILED), "bottle")


def test_figures_under_noise_stand_in_their_fields_and_count_with_samples_alone() -> None:
    known = QualityUnderNoise(0.35, 0.05, 0.2, 8)
    message = to_grasp_quality_msg(StampedGrasp(1, replace(GRASP, under_noise=known)), "bottle")
    figures = (message.expected_quality, message.quality_sd, message.worst_quality, message.noise_samples)
    assert figures == (0.35, 0.05, 0.2, 8)
    message = quality_msg()
    assert math.isnan(message.expected_quality + message.quality_sd + message.worst_quality)
    assert message.noise_samples == GraspQuality().noise_samples == 0
    assert from_grasp_quality_msg(message, "bottle").grasp.under_noise is None
    assert from_grasp_quality_msg(quality_msg(worst_quality=0.0), "bottle").grasp.under_noise is None
    with pytest.raises(InvalidQualityError, match="finite"):
        from_grasp_quality_msg(quality_msg(noise_samples=3), "bottle")


def test_an_unknown_outcome_is_refused_and_the_known_are_named() -> None:
    with pytest.raises(InvalidMessageError, match=r"outcome 9 is unknown.*COLLISION=2"):
        from_grasp_quality_msg(quality_msg(outcome=9), "bottle")


def test_another_frame_is_refused_and_both_are_named() -> None:
    with pytest.raises(WrongFrameError, match=r"'bottle'.*'mug'"):
        from_grasp_quality_msg(quality_msg(), "mug")
    with pytest.raises(WrongFrameError, match=r"''.*'bottle'"):
        from_pose_stamped_msg(PoseStamped(), "bottle")


def test_poses_that_are_none_are_refused() -> None:
    message = to_pose_stamped_msg(1, "bottle", Pose.identity())
    message.pose.orientation.w = 0.0
    with pytest.raises(InvalidPoseError, match="norm 0"):
        from_pose_stamped_msg(message, "bottle")
    message = to_pose_stamped_msg(1, "bottle", Pose.identity())
    message.pose.position.y = math.nan
    with pytest.raises(InvalidPoseError, match="finite"):
        from_pose_stamped_msg(message, "bottle")


def test_normals_off_by_rounding_are_mended_and_others_refused() -> None:
    message = quality_msg()
    message.contacts[0].normal = Vector3(x=0.0, y=0.6001, z=0.8)
    (contact,) = from_grasp_quality_msg(message, "bottle").grasp.contacts
    assert np.linalg.norm(contact.normal) == pytest.approx(1.0, abs=1e-12)
    message.contacts[0].normal = Vector3(x=0.0, y=0.7, z=0.8)
    with pytest.raises(InvalidPoseError, match="unit length"):
        from_grasp_quality_msg(message, "bottle")


def test_a_joint_without_position_is_refused() -> None:
    message = quality_msg()
    message.hand_posture.position = [1.3]
    with pytest.raises(InvalidPoseError, match="2 names"):
        from_grasp_quality_msg(message, "bottle")


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (0, 1_000_000_000), (5, 4_294_967_295)])
def test_stamps_that_are_no_times_are_refused(sec: int, nanosec: int) -> None:
    with pytest.raises(InvalidMessageError, match="not a time"):
        from_time_msg(Time(sec=sec, nanosec=nanosec))


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_stamps_that_do_not_fit_are_refused(stamp_ns: int) -> None:
    with pytest.raises(InvalidMessageError, match="outside"):
        to_time_msg(stamp_ns)
    with pytest.raises(InvalidMessageError, match="outside"):
        to_joint_state_msg(HandPosture(), stamp_ns)


def test_durations_are_rounded_to_nanoseconds_and_keep_their_sign() -> None:
    assert from_duration_msg(to_duration_msg(1.2345678904)) == pytest.approx(1.23456789, abs=1e-15)
    assert from_duration_msg(to_duration_msg(-0.25)) == -0.25
    with pytest.raises(InvalidMessageError):
        to_duration_msg(math.nan)
    with pytest.raises(InvalidMessageError):
        to_duration_msg(1e12)


def primitive(kind: int, *dimensions: float) -> OcclusionMsg:
    message = OcclusionMsg(id="cup", shape=SolidPrimitive(type=kind, dimensions=list(dimensions)))
    message.header.frame_id = "bottle"
    return message


def test_heights_stand_before_radii() -> None:
    assert from_occlusion_msg(primitive(SolidPrimitive.BOX, 1, 2, 3), "bottle").shape == Box((1, 2, 3))
    assert from_occlusion_msg(primitive(SolidPrimitive.SPHERE, 1), "bottle").shape == Sphere(1)
    cylinder = from_occlusion_msg(primitive(SolidPrimitive.CYLINDER, 2, 1), "bottle").shape
    assert cylinder == Cylinder(height=2, radius=1)
    cone = from_occlusion_msg(primitive(SolidPrimitive.CONE, 2, 1), "bottle").shape
    assert cone == Cone(height=2, radius=1)


def test_unknown_and_incomplete_primitives_are_refused() -> None:
    with pytest.raises(InvalidMessageError, match="'cup': primitive type 5"):
        from_occlusion_msg(primitive(SolidPrimitive.PRISM, 1, 2), "bottle")
    with pytest.raises(InvalidMessageError, match="'cup': a CYLINDER has 2 dimensions, got 1"):
        from_occlusion_msg(primitive(SolidPrimitive.CYLINDER, 1), "bottle")
    for length in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InvalidOcclusionError, match="'cup': sphere: radius"):
            from_occlusion_msg(primitive(SolidPrimitive.SPHERE, length), "bottle")


def test_an_occlusion_in_another_frame_is_refused_and_both_are_named() -> None:
    with pytest.raises(WrongFrameError, match=r"'cup'.*'bottle'.*'mug'"):
        from_occlusion_msg(primitive(SolidPrimitive.SPHERE, 1), "mug")


def in_frame(frame: str) -> OcclusionMsg:
    message = primitive(SolidPrimitive.BOX, 1, 2, 3)
    message.header.frame_id = frame
    message.pose.position.x = 1.0
    return message


QUARTER = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
"""A quarter turn about z: x becomes y."""


def test_known_transforms_lead_an_occlusion_into_the_objects_frame() -> None:
    frames = FrameTree(
        [
            FrameTransform("world", "bottle", Pose(np.array([0.0, 0.0, 1.0]))),
            FrameTransform("world", "/camera", Pose(np.array([2.0, 0.0, 0.0]), QUARTER)),
        ]
    )
    found = from_occlusion_msg(in_frame("/camera"), "bottle", frames).T_object_shape
    np.testing.assert_allclose(found.position, [2.0, 1.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(found.transform_points([1.0, 0.0, 0.0]), [2.0, 2.0, -1.0], atol=1e-12)


def test_a_transform_in_the_message_counts_for_it_alone() -> None:
    message = in_frame("camera")
    place = FrameTransform("camera", "bottle", Pose(np.array([0.25, 0.0, 0.0])))
    message.transforms = [to_transform_stamped_msg(place)]
    found = from_occlusion_msg(message, "bottle")
    np.testing.assert_allclose(found.T_object_shape.position, [0.75, 0.0, 0.0])
    other = in_frame("camera")
    other.id = "mug"
    with pytest.raises(WrongFrameError, match="'mug'"):
        from_occlusion_msgs([message, other], "bottle")


def test_unusable_transforms_are_refused_by_name() -> None:
    message = in_frame("camera")
    transform = to_transform_stamped_msg(FrameTransform("camera", "bottle", Pose.identity()))
    transform.transform.rotation.w = 0.0
    message.transforms = [transform]
    with pytest.raises(InvalidMessageError, match=r"'cup'.*from 'camera' to 'bottle'.*norm 0"):
        from_occlusion_msg(message, "bottle")
    transform.transform.rotation.w = 1.0
    transform.child_frame_id = ""
    with pytest.raises(InvalidMessageError, match="two different frames"):
        from_occlusion_msg(message, "bottle")


def test_a_transform_survives_the_way_through_a_message() -> None:
    place = FrameTransform("a", "b", Pose.from_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]))
    back = from_transform_stamped_msg(to_transform_stamped_msg(place, 7))
    assert (back.parent, back.child) == ("a", "b")
    np.testing.assert_allclose(back.T_parent_child.matrix, place.T_parent_child.matrix, atol=1e-15)


def test_a_margin_is_kept_and_a_negative_one_refused() -> None:
    message = to_occlusion_msg(Occlusion("cup", Sphere(0.1), Pose.identity(), margin=0.02), "bottle")
    assert from_occlusion_msg(message, "bottle").margin == 0.02
    for margin in (-0.01, math.nan, math.inf):
        message.margin = margin
        with pytest.raises(InvalidOcclusionError, match=r"^occlusion 'cup': margin"):
            from_occlusion_msg(message, "bottle")


def test_names_of_occlusions_are_unique_and_not_empty() -> None:
    cup = primitive(SolidPrimitive.SPHERE, 1)
    with pytest.raises(InvalidOcclusionError, match=r"unique.*cup"):
        from_occlusion_msgs([cup, cup], "bottle")
    nameless = primitive(SolidPrimitive.SPHERE, 1)
    nameless.id = ""
    with pytest.raises(InvalidOcclusionError, match="name"):
        from_occlusion_msgs([nameless], "bottle")


def test_an_array_of_occlusions_keeps_their_order() -> None:
    known = (
        Occlusion("b", Sphere(0.1), Pose(np.array([0.1, 0.0, 0.0]))),
        Occlusion("a", Cone(0.2, 0.1), Pose.identity()),
    )
    message = to_occlusion_array_msg(known, "bottle", 7)
    assert message.header.frame_id == "bottle"
    found = from_occlusion_array_msg(message, "bottle")
    assert [(o.id, o.shape) for o in found] == [(o.id, o.shape) for o in known]


def test_a_mesh_is_sent_instead_of_a_shape() -> None:
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))
    message = to_occlusion_msg(Occlusion("o", mesh, Pose.identity()), "bottle")
    found = from_occlusion_msg(message, "bottle").shape
    assert isinstance(found, TriangleMesh)
    np.testing.assert_array_equal(found.vertices, mesh.vertices)
    message.shape = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[1.0])
    with pytest.raises(InvalidMessageError, match="'o': both a mesh and the dimensions"):
        from_occlusion_msg(message, "bottle")


def test_a_mesh_keeps_its_corners_and_faces() -> None:
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2], [2, 1, 0]]))
    found = from_mesh_msg(to_mesh_msg(mesh))
    np.testing.assert_array_equal(found.vertices, mesh.vertices)
    np.testing.assert_array_equal(found.faces, mesh.faces)
    with pytest.raises(InvalidOcclusionError, match="faces must have shape"):
        from_mesh_msg(MeshMsg())
    broken = to_mesh_msg(mesh)
    broken.triangles[0].vertex_indices = [0, 1, 7]
    with pytest.raises(InvalidOcclusionError, match="0 to 7, there are 3"):
        from_mesh_msg(broken)


def test_a_set_keeps_its_figures() -> None:
    grasps = (StampedGrasp(2, GRASP), StampedGrasp(1, GRASP))
    solutions = SolutionSet.of("bottle", grasps, 0.04, PoseMetric())
    message = to_solution_set_msg(solutions, 99)
    assert message.header.stamp.nanosec == 99
    found = from_solution_set_msg(message)
    assert [s.stamp_ns for s in found.grasps] == [2, 1]
    assert (found.diverse, found.mean_quality, found.qd) == (1, 0.4, 0.0)
    message.diverse = 3
    with pytest.raises(InvalidMessageError, match="2 grasps cannot have 3"):
        from_solution_set_msg(message)


def test_poses_go_out_as_an_array() -> None:
    message = to_pose_array_msg(3, "bottle", [Pose.identity(), GRASP.T_object_tcp])
    assert message.header.frame_id == "bottle"
    assert [pose.position.z for pose in message.poses] == [0.0, 0.1]
