"""Where frames are: ``geometry_msgs/TransformStamped``, as on ``/tf_static``."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Transform, TransformStamped

from mebo_grasp.errors import InvalidFrameError, InvalidMessageError, InvalidPoseError
from mebo_grasp.grasp import Pose
from mebo_grasp.solutions.frames import FrameTransform
from msg_adapters.pose import from_point_msg, to_pose_msg, to_vector_msg
from msg_adapters.time import to_time_msg


def to_transform_stamped_msg(transform: FrameTransform, stamp_ns: int = 0) -> TransformStamped:
    """Return the message of a transform.

    Raises:
        InvalidMessageError: the stamp does not fit into a message.
    """
    pose = transform.T_parent_child
    message = TransformStamped(
        child_frame_id=transform.child,
        transform=Transform(translation=to_vector_msg(pose.position), rotation=to_pose_msg(pose).orientation),
    )
    message.header.frame_id = transform.parent
    message.header.stamp = to_time_msg(stamp_ns)
    return message


def from_transform_stamped_msg(message: TransformStamped) -> FrameTransform:
    """Return the transform of a message.

    Raises:
        InvalidMessageError: a frame has no name, both are the same, or a number is not usable.
    """
    turn = message.transform.rotation
    parent, child = message.header.frame_id, message.child_frame_id
    try:
        pose = Pose(from_point_msg(message.transform.translation), np.array([turn.x, turn.y, turn.z, turn.w]))
        return FrameTransform(parent, child, pose)
    except (InvalidFrameError, InvalidPoseError) as error:
        raise InvalidMessageError(f"transform from '{parent}' to '{child}': {error}") from error
