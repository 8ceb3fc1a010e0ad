"""The client's side of an exploration: follows its status and asks for its grasps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from mebo_grasp_interfaces.msg import ExplorationStatus
from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mebo_grasp.errors import MeboGraspError
from mebo_grasp.nodes import qos


class ExplorationClient:
    """Talks to the three nodes of one exploration.

    Args:
        domain_id: DDS domain of the nodes.

    Use as a context manager; every wait has a time limit.
    """

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self._node = Node("exploration_client", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.status: ExplorationStatus | None = None
        """The newest status; None before the first."""
        self._node.create_subscription(ExplorationStatus, "exploration_status", self._on_status, qos.LATCHED)
        self._best = self._node.create_client(GetBestGrasp, "get_best_grasp")
        self._set = self._node.create_client(GetSolutionSet, "get_solution_set")

    def __enter__(self) -> ExplorationClient:
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _on_status(self, status: ExplorationStatus) -> None:
        self.status = status

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

    def get_solution_set(self, timeout: float = 10.0) -> SolutionSetMsg:
        """Ask for the set of diverse grasps."""
        return self._call(self._set, GetSolutionSet.Request(), timeout).solution_set

    def get_best_grasp(self, request: GetBestGrasp.Request, timeout: float = 10.0) -> GetBestGrasp.Response:
        """Ask for the best grasps that are not occluded."""
        return self._call(self._best, request, timeout)

    def _call(self, client: Any, request: Any, timeout: float) -> Any:
        future = client.call_async(request)
        self.wait_until(future.done, timeout, f"an answer of service {client.srv_name}")
        return future.result()
