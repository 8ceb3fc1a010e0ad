"""Poses: ``geometry_msgs`` and ``mebo_grasp.grasp.Pose``."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point, PoseArray, PoseStamped, Vector3
from geometry_msgs.msg import Pose as PoseMsg

from mebo_grasp.grasp import FloatArray, Pose
from msg_adapters.checks import require_frame
from msg_adapters.time import to_time_msg


def to_pose_msg(pose: Pose) -> PoseMsg:
    """Return the message of a pose."""
    message = PoseMsg()
    write_point(message.position, pose.position)
    to = message.orientation
    to.x, to.y, to.z, to.w = pose.quaternion_xyzw.tolist()
    return message


def from_pose_msg(message: PoseMsg) -> Pose:
    """Return the pose of a message.

    Raises:
        InvalidPoseError: a number is not finite or the quaternion is not of unit norm.
    """
    orientation = message.orientation
    return Pose(
        from_point_msg(message.position),
        np.array([orientation.x, orientation.y, orientation.z, orientation.w]),
    )


def to_pose_stamped_msg(stamp_ns: int, frame_id: str, pose: Pose) -> PoseStamped:
    """Return the message of a pose with its identity and its frame.

    Args:
        stamp_ns: nanoseconds since the epoch.
        frame_id: the parent frame of the pose.
        pose: to be sent.

    Raises:
        InvalidMessageError: the stamp does not fit into a message.
    """
    message = PoseStamped(pose=to_pose_msg(pose))
    message.header.stamp = to_time_msg(stamp_ns)
    message.header.frame_id = frame_id
    return message


def from_pose_stamped_msg(message: PoseStamped, expected_frame: str) -> Pose:
    """Return the pose of a message; its stamp is read with ``from_time_msg``.

    Raises:
        WrongFrameError: the message is given in another frame.
        InvalidPoseError: a number is not finite or the quaternion is not of unit norm.
    """
    require_frame(message.header.frame_id, expected_frame, "a stamped pose")
    return from_pose_msg(message.pose)


def to_pose_array_msg(stamp_ns: int, frame_id: str, poses: Iterable[Pose]) -> PoseArray:
    """Return several poses of one frame as one message, as RViz shows them.

    Raises:
        InvalidMessageError: the stamp does not fit into a message.
    """
    message = PoseArray(poses=[to_pose_msg(pose) for pose in poses])
    message.header.stamp = to_time_msg(stamp_ns)
    message.header.frame_id = frame_id
    return message


def to_point_msg(point: FloatArray) -> Point:
    """Return the message of a point, shape (3,), metres."""
    message = Point()
    write_point(message, point)
    return message


def to_vector_msg(vector: FloatArray) -> Vector3:
    """Return the message of a vector, shape (3,)."""
    message = Vector3()
    write_point(message, vector)
    return message


def write_point(message: Point | Vector3, point: FloatArray) -> None:
    """Write a point or vector, shape (3,), into a message or a part of one.

    A message makes its parts when it is made: to fill them takes half the time of giving it new ones.
    """
    message.x, message.y, message.z = map(float, point.tolist())


def from_point_msg(message: Point | Vector3) -> FloatArray:
    """Return the numbers of a point or vector, shape (3,), not yet checked."""
    return np.array([message.x, message.y, message.z], dtype=np.float64)
