"""The topics on which the optimizer reaches its hands, and which of the hands are there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from mebo_grasp.grasp import HandPosture, Pose
from mebo_grasp.nodes import qos
from msg_adapters.grasp import to_joint_state_msg
from msg_adapters.pose import to_pose_stamped_msg


class HandLinks:
    """``<hand>/candidate_pose``, and ``<hand>/candidate_posture`` where postures go out too.

    Args:
        node: publishes.
        hands: namespaces of the hands; "" for one without.
        frame_id: of the poses, the object's name.
        with_posture: whether a hand must listen to postures too.
    """

    def __init__(self, node: Node, hands: Sequence[str], frame_id: str, with_posture: bool) -> None:
        self._frame_id = frame_id
        prefixes = {hand: f"{hand}/" if hand else "" for hand in hands}
        self._poses = {
            hand: node.create_publisher(PoseStamped, f"{prefix}candidate_pose", qos.CANDIDATES)
            for hand, prefix in prefixes.items()
        }
        self._postures = {
            hand: node.create_publisher(JointState, f"{prefix}candidate_posture", qos.CANDIDATES)
            for hand, prefix in prefixes.items()
            if with_posture
        }
        self._seen: set[str] = set()
        self._anybody_answers = False
        self.ready: tuple[str, ...] = ()
        """Hands that can be given trials."""

    def look(self, anybody_answers: bool) -> list[str]:
        """Look for hands that came or went.

        Args:
            anybody_answers: whether somebody publishes grasp qualities so that they are heard. Who only listens to
                candidates, such as `ros2 topic echo`, is no hand.

        Returns:
            The hands that are gone since the last look.
        """
        self._anybody_answers = anybody_answers
        seen = {hand for hand in self._poses if anybody_answers and self._listens(hand)}
        # A hand that was seen just now may not yet see this node: what was sent to it would be lost.
        ready = tuple(hand for hand in self._poses if hand in seen & self._seen)
        gone = [hand for hand in self.ready if hand not in ready]
        self._seen, self.ready = seen, ready
        return gone

    def send(self, hand: str, stamp_ns: int, T_object_tcp: Pose, posture: HandPosture | None) -> None:
        """Publish a candidate, its posture first."""
        if posture is not None:
            self._postures[hand].publish(to_joint_state_msg(posture, stamp_ns))
        self._poses[hand].publish(to_pose_stamped_msg(stamp_ns, self._frame_id, T_object_tcp))

    def what_is_missing(self) -> str:
        """Say on which topics a hand is waited for, or why one that is there cannot be used."""
        topics = [publisher.topic_name for hand in self._poses for publisher in self._publishers_to(hand)]
        hint = " (hand_node with expects_posture: true)" if self._postures else ""
        waiting = f"waiting for a hand on {', '.join(topics)}{hint}"
        if self._anybody_answers or not any(self._listens(hand) for hand in self._poses):
            return waiting
        return (
            f"{waiting}: somebody listens there, but nobody publishes grasp_quality with the QoS reliable and "
            "transient local"
        )

    def describe(self, hands: Iterable[str]) -> str:
        """Name hands by the topics on which they listen."""
        return "hand on " + ", ".join(self._poses[hand].topic_name for hand in hands)

    def _listens(self, hand: str) -> bool:
        return all(publisher.get_subscription_count() > 0 for publisher in self._publishers_to(hand))

    def _publishers_to(self, hand: str) -> list[Publisher]:
        return [publishers[hand] for publishers in (self._poses, self._postures) if hand in publishers]
