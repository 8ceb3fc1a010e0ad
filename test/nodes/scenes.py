"""What the node tests have in common: whole explorations, hands played by the test, requests."""

from __future__ import annotations

import threading
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality, Occlusion
from mebo_grasp_interfaces.srv import GetSolutionSet
from shape_msgs.msg import SolidPrimitive

from mebo_grasp.nodes import qos

from .harness import Inbox, NodeUnderTest, Probe

OBJECT = "bottle"


class Scene:
    """Three nodes exploring one object, with everything they publish."""

    def __init__(self, launch: Callable[..., NodeUnderTest], probe: Probe, folder: Path, budget: int) -> None:
        self._launch = launch
        self.probe = probe
        self.parameters: dict[str, dict[str, Any]] = {
            "hand_node": {"object": OBJECT},
            "solution_set_node": {"object": OBJECT, "database": str(folder / "trials.db")},
            "optimizer_node": {
                "object": OBJECT,
                "budget": budget,
                "run_log": str(folder / "run.jsonl"),
                "trial_timeout": 2.0,
            },
        }
        self.status = probe.listen(ExplorationStatus, "exploration_status", qos.LATCHED)
        self.qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
        self.candidates = probe.listen(PoseStamped, "candidate_pose", qos.CANDIDATES)
        self.nodes: dict[str, NodeUnderTest] = {}

    def start(self, *names: str) -> None:
        """Start nodes by name; all three when none is named."""
        for name in names or self.parameters:
            self.nodes[name] = self._launch(name, **self.parameters[name])

    def wait_for_evaluations(self, count: int, after: int = 0) -> ExplorationStatus:
        """Wait until the optimizer has been told so many trials."""
        return self.status.wait_for(lambda status: status.evaluations >= count, after=after)

    def wait_until_finished(self, timeout: float = 120.0) -> ExplorationStatus:
        """Wait for the end of the exploration."""
        return self.status.wait_for(lambda status: status.state == ExplorationStatus.FINISHED, timeout=timeout)

    def stored(self) -> int:
        """Return how many trials the solution set node has stored."""
        request = GetSolutionSet.Request()
        return int(self.probe.call(GetSolutionSet, "get_solution_set", request).solution_set.stored)


class PlayedHand:
    """A hand played by the test: it answers candidates as it is told to."""

    def __init__(self, probe: Probe, namespace: str = "") -> None:
        self._publisher = probe.node.create_publisher(GraspQuality, "grasp_quality", qos.QUALITIES)
        self._probe = probe
        self._lock = threading.Lock()
        self.respond: Callable[[PoseStamped], list[GraspQuality]] = lambda candidate: [answer(candidate)]
        topic = f"{namespace}/candidate_pose" if namespace else "candidate_pose"
        self.candidates: Inbox[PoseStamped] = Inbox()
        probe.node.create_subscription(PoseStamped, topic, self._on_candidate, qos.CANDIDATES)

    def _on_candidate(self, candidate: PoseStamped) -> None:
        self.candidates.put(candidate)
        for quality in self.respond(candidate):
            self.send(quality)

    def send(self, quality: GraspQuality) -> None:
        """Publish an answer."""
        with self._lock:
            self._publisher.publish(quality)


def answer(candidate: PoseStamped, quality: float | None = None) -> GraspQuality:
    """Return an answer to a candidate; its quality is highest where x is 0."""
    message = GraspQuality()
    message.header = deepcopy(candidate.header)
    message.tcp_pose = deepcopy(candidate.pose)
    message.outcome = GraspQuality.GRASPED
    message.quality = 1.0 - abs(candidate.pose.position.x) if quality is None else quality
    message.epsilon = message.quality
    message.object_id = OBJECT
    message.hand = "played"
    return message


def box_occlusion(
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    frame: str = OBJECT,
    name: str = "box",
) -> Occlusion:
    """Return an occlusion by an axis-aligned box."""
    occlusion = Occlusion()
    occlusion.header.frame_id = frame
    occlusion.id = name
    occlusion.shape.type = SolidPrimitive.BOX
    occlusion.shape.dimensions = list(size)
    occlusion.pose.position.x, occlusion.pose.position.y, occlusion.pose.position.z = center
    occlusion.pose.orientation.w = 1.0
    return occlusion
