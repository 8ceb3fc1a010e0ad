"""Values survive the way through messages and their wire format; no message breaks a converter."""

import contextlib

import numpy as np
from geometry_msgs.msg import TransformStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from mebo_grasp_interfaces.msg import GraspQuality
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from rclpy.serialization import deserialize_message, serialize_message

from mebo_grasp.errors import MeboGraspError
from mebo_grasp.grasp import Grasp, Pose, StampedGrasp
from mebo_grasp.solutions.occlusion import Occlusion
from msg_adapters.grasp import from_grasp_quality_msg, to_grasp_quality_msg
from msg_adapters.occlusion import from_occlusion_msg, to_occlusion_msg
from msg_adapters.pose import from_pose_stamped_msg, to_pose_stamped_msg
from msg_adapters.time import from_time_msg, to_time_msg
from test.property.solution_strategies import grasps, occlusions, poses, same_grasp

stamps = st.integers(0, 2**31 * 10**9 - 1)
any_float = st.floats(width=64)
any_text = st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=5)


@given(stamp_ns=stamps)
def test_stamps(stamp_ns: int) -> None:
    assert from_time_msg(to_time_msg(stamp_ns)) == stamp_ns


@given(pose=poses(), stamp_ns=stamps)
def test_poses(pose: Pose, stamp_ns: int) -> None:
    message = to_pose_stamped_msg(stamp_ns, "bottle", pose)
    back = from_pose_stamped_msg(message, "bottle")
    assert from_time_msg(message.header.stamp) == stamp_ns
    np.testing.assert_array_equal(back.position, pose.position)
    np.testing.assert_allclose(back.quaternion_xyzw, pose.quaternion_xyzw, rtol=0, atol=1e-15)


@settings(deadline=None)
@given(grasp=grasps(), stamp_ns=stamps)
def test_grasps_over_the_wire(grasp: Grasp, stamp_ns: int) -> None:
    wire = serialize_message(to_grasp_quality_msg(StampedGrasp(stamp_ns, grasp), "bottle"))
    back = from_grasp_quality_msg(deserialize_message(wire, GraspQuality), "bottle")
    assert back.stamp_ns == stamp_ns
    assert same_grasp(back.grasp, grasp)


@settings(deadline=None)
@given(found=occlusions())
def test_occlusions_over_the_wire(found: tuple[Occlusion, ...]) -> None:
    for occlusion in found:
        wire = serialize_message(to_occlusion_msg(occlusion, "bottle"))
        back = from_occlusion_msg(deserialize_message(wire, OcclusionMsg), "bottle")
        assert (back.id, back.shape) == (occlusion.id, occlusion.shape)
        np.testing.assert_allclose(back.T_object_shape.matrix, occlusion.T_object_shape.matrix, rtol=0, atol=1e-14)


@st.composite
def any_quality_msg(draw: st.DrawFn) -> GraspQuality:
    message = to_grasp_quality_msg(StampedGrasp(draw(stamps), draw(grasps())), draw(any_text))
    for name in draw(st.lists(st.sampled_from(["quality", "epsilon", "volume", "isotropy"]))):
        setattr(message, name, draw(any_float))
    message.outcome = draw(st.integers(0, 255))
    message.tcp_pose.position.x = draw(any_float)
    message.tcp_pose.orientation.w = draw(any_float)
    message.header.stamp.sec = draw(st.integers(-(2**31), 2**31 - 1))
    message.header.stamp.nanosec = draw(st.integers(0, 2**32 - 1))
    message.hand_posture.position = draw(st.lists(any_float, max_size=3))
    for contact in message.contacts:
        contact.normal.x = draw(any_float)
    return message


@settings(deadline=None)
@given(message=any_quality_msg())
def test_any_answer_is_a_value_or_a_typed_error(message: GraspQuality) -> None:
    with contextlib.suppress(MeboGraspError):
        assert isinstance(from_grasp_quality_msg(message, message.header.frame_id), StampedGrasp)


@settings(deadline=None)
@given(
    name=any_text,
    kind=st.integers(0, 255),
    dimensions=st.lists(any_float, max_size=3),
    position=any_float,
    w=any_float,
    margin=any_float,
    translation=any_float,
)
def test_any_occlusion_is_a_value_or_a_typed_error(
    name: str,
    kind: int,
    dimensions: list[float],
    position: float,
    w: float,
    margin: float,
    translation: float,
) -> None:
    message = OcclusionMsg(id=name, margin=margin)
    if translation:
        message.header.frame_id = "camera"
        message.transforms = [TransformStamped(child_frame_id="camera")]
        message.transforms[0].transform.translation.x = translation
    message.shape.type, message.shape.dimensions = kind, dimensions
    message.pose.position.x, message.pose.orientation.w = position, w
    with contextlib.suppress(MeboGraspError):
        assert isinstance(from_occlusion_msg(message, ""), Occlusion)
