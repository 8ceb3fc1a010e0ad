"""The static transforms that a node knows: from its parameter, and from ``/tf_static`` where tf2 is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError
from mebo_grasp.grasp import Pose
from mebo_grasp.nodes import qos
from mebo_grasp.solutions.frames import FrameTransform, FrameTree
from msg_adapters.transform import from_transform_stamped_msg

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # the ROS wheels of the package index have no tf2
    TFMessage = None

NUMBERS = 7


def parse_transform(text: str) -> FrameTransform:
    """Return the transform written as ``parent child x y z qx qy qz qw``, metres and xyzw.

    Raises:
        InvalidSettingsError: it is written in another way, or its numbers are not usable.
    """
    words = text.split()
    try:
        if len(words) != 2 + NUMBERS:
            raise ValueError(f"{len(words)} words instead of {2 + NUMBERS}")
        numbers = np.array([float(word) for word in words[2:]])
        return FrameTransform(words[0], words[1], Pose(numbers[:3], numbers[3:]))
    except ValueError as error:
        raise InvalidSettingsError(
            f"static_transforms: '{text}' is not 'parent child x y z qx qy qz qw' [m, xyzw]: {error}"
        ) from error


class KnownFrames:
    """Keeps the tree of frames of a node up to date.

    Args:
        node: hears ``/tf_static``.
        texts: transforms given by parameter, as ``parse_transform`` reads them.
        on_change: called when a transform was heard.

    Raises:
        InvalidSettingsError: a text is no transform.
    """

    def __init__(self, node: Node, texts: Sequence[str], on_change: Callable[[], None]) -> None:
        self.tree = FrameTree(parse_transform(text) for text in texts)
        self._node, self._on_change = node, on_change
        if TFMessage is None:
            node.get_logger().debug("tf2_msgs is not installed: /tf_static is not heard")
            return
        node.create_subscription(TFMessage, "/tf_static", self._on_tf_static, qos.TF_STATIC)

    def _on_tf_static(self, message: Any) -> None:
        try:
            self.tree = self.tree.updated(self._usable(message.transforms))
            self._on_change()
        except MeboGraspError as error:
            self._node.get_logger().warning(f"/tf_static: {error}")
        except Exception as error:
            # An exception that leaves a callback ends spin() and with it the node.
            self._node.get_logger().error(f"/tf_static: unexpected {type(error).__name__}: {error}")

    def _usable(self, messages: Iterable[TransformStamped]) -> Iterator[FrameTransform]:
        """Yield the transforms that can be used; any other is named and does not stand in their way."""
        for message in messages:
            try:
                yield from_transform_stamped_msg(message)
            except MeboGraspError as error:
                self._node.get_logger().warning(f"/tf_static: {error}")
