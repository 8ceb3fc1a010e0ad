"""The client's side of an exploration: follows its status and asks for its grasps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from mebo_grasp.errors import MeboGraspError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.nodes import qos
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.occlusion import Occlusion
from msg_adapters.grasp import from_grasp_quality_msg
from msg_adapters.occlusion import to_occlusion_msg

RESEND_AFTER = 3.0
"""Seconds after which a request without an answer is sent again."""


@dataclass(frozen=True)
class Standing:
    """Where an exploration stands.

    Args:
        evaluations: trials told, failed ones included.
        budget: trials in all.
        best_quality: NaN before the first value.
        seconds_per_trial: mean of late; 0 when unknown.
        pending: candidates without an answer.
        exploring: whether new candidates are sent.
        finished: whether the budget is spent.
        note: what a person should know, empty for nothing.
    """

    evaluations: int
    budget: int
    best_quality: float
    seconds_per_trial: float
    pending: int
    exploring: bool
    finished: bool
    note: str


@dataclass(frozen=True)
class KeptSet:
    """The solution set as the node reports it; see ``mebo_grasp_interfaces/SolutionSet``."""

    grasps: tuple[StampedGrasp, ...]
    stored: int
    mean_quality: float
    mean_min_distance: float


@dataclass(frozen=True)
class BestAnswer:
    """The best grasp now, or None with the reason; see ``mebo_grasp_interfaces/GetBestGrasp``."""

    best: StampedGrasp | None
    considered: int
    occluded: int
    message: str


_RULES = {
    BlockingRule.TCP: GetBestGrasp.Request.RULE_TCP,
    BlockingRule.HAND: GetBestGrasp.Request.RULE_HAND,
}


class ExplorationClient:
    """Talks to the three nodes of one exploration.

    Args:
        domain_id: DDS domain of the nodes.
        object_id: name of the object, and of its frame.

    Use as a context manager; every wait has a time limit.
    """

    def __init__(self, domain_id: int, object_id: str) -> None:
        self._object_id = object_id
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self._node = Node("exploration_client", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.standing: Standing | None = None
        """Where the exploration stands by its newest status; None before the first."""
        self._node.create_subscription(ExplorationStatus, "exploration_status", self._on_status, qos.LATCHED)
        self._best = self._node.create_client(GetBestGrasp, "get_best_grasp")
        self._set = self._node.create_client(GetSolutionSet, "get_solution_set")
        self._pause = self._node.create_client(Trigger, "optimizer_node/pause")

    def __enter__(self) -> ExplorationClient:
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _on_status(self, status: ExplorationStatus) -> None:
        self.standing = Standing(
            evaluations=status.evaluations,
            budget=status.budget,
            best_quality=status.best_quality,
            seconds_per_trial=status.seconds_per_trial,
            pending=status.pending,
            exploring=status.state == ExplorationStatus.EXPLORING,
            finished=status.state == ExplorationStatus.FINISHED,
            note=status.message,
        )

    def spin(self, seconds: float) -> None:
        """Take messages for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def wait_until(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        """Take messages until a condition holds.

        Raises:
            MeboGraspError: it does not hold after ``timeout`` seconds; names ``what`` was waited for.
        """
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                raise MeboGraspError(f"{what} did not come within {timeout:.0f} s")
            self._executor.spin_once(timeout_sec=0.05)

    def services_ready(self) -> bool:
        """Whether both services can be called now."""
        return bool(self._best.service_is_ready() and self._set.service_is_ready())

    def pause(self, timeout: float = 10.0) -> None:
        """Let no new candidate be sent, and wait for the answers to those that are out.

        Raises:
            MeboGraspError: the optimizer or a hand did not answer in time.
        """
        self._call(self._pause, Trigger.Request(), timeout)
        self.wait_until(self._is_quiet, timeout, "the answers to the last candidates")

    def _is_quiet(self) -> bool:
        return self.standing is not None and not self.standing.exploring and self.standing.pending == 0

    def solution_set(self, timeout: float = 10.0) -> KeptSet:
        """Ask for the set of diverse grasps.

        Raises:
            MeboGraspError: no answer came in time.
        """
        answer = self._call(self._set, GetSolutionSet.Request(), timeout).solution_set
        return KeptSet(
            grasps=self._grasps(answer.grasps),
            stored=answer.stored,
            mean_quality=answer.mean_quality,
            mean_min_distance=answer.mean_min_distance,
        )

    def best_grasp(self, occlusions: Sequence[Occlusion], rule: BlockingRule, timeout: float = 10.0) -> BestAnswer:
        """Ask for the best grasp that is not occluded.

        Args:
            occlusions: beside those that the node knows.
            rule: when a grasp counts as blocked.
            timeout: seconds.

        Raises:
            MeboGraspError: no answer came in time.
        """
        messages = [to_occlusion_msg(occlusion, self._object_id) for occlusion in occlusions]
        request = GetBestGrasp.Request(occlusions=messages, rule=_RULES[rule])
        response = self._call(self._best, request, timeout)
        best = self._grasps(response.grasps)
        return BestAnswer(best[0] if best else None, response.considered, response.occluded, response.message)

    def _grasps(self, messages: Sequence[GraspQuality]) -> tuple[StampedGrasp, ...]:
        return tuple(from_grasp_quality_msg(message, expected_frame=self._object_id) for message in messages)

    def _call(self, client: Any, request: Any, timeout: float) -> Any:
        """Return a service's answer; every service called here may be asked twice without harm.

        A request to a node that was killed, or whose way back is not known yet, gets no answer: it is sent again.
        """
        futures = [client.call_async(request)]
        sent = time.monotonic()

        def answered() -> bool:
            nonlocal sent
            if time.monotonic() > sent + RESEND_AFTER:
                futures.append(client.call_async(request))
                sent = time.monotonic()
            return any(future.done() for future in futures)

        self.wait_until(answered, timeout, f"an answer of service {client.srv_name}")
        return next(future.result() for future in futures if future.done())
