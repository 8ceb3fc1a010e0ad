"""Real nodes as real processes on a DDS domain of their own; every wait is for an event, with a limit."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Generic, TypeVar

import yaml
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

WAIT = 60.0
"""Limit of a wait in seconds, more than ten times what is expected; no test passes by waiting for it."""

RESEND_AFTER = 5.0
"""After so many seconds without an answer a request is sent again."""

Message = TypeVar("Message")


class NodeUnderTest:
    """One of the package's executables in a process of its own."""

    def __init__(self, executable: str, parameters: dict[str, Any], directory: Path, domain_id: int) -> None:
        self.log_path = directory / f"{executable}-{time.monotonic_ns()}.log"
        parameter_file = self.log_path.with_suffix(".yaml")
        parameter_file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
        command = [str(Path(sys.executable).parent / executable)]
        command += ["--ros-args", "--params-file", str(parameter_file)]
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain_id),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)

    @property
    def log(self) -> str:
        """What the node has printed so far."""
        return self.log_path.read_text(errors="replace")

    def wait_for_log(self, text: str, timeout: float = WAIT) -> None:
        """Wait until the node has printed a text."""
        wait_until(lambda: text in self.log or not self.alive, timeout, lambda: f"'{text}' in:\n{self.log}")
        assert text in self.log, self.log

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    def kill(self) -> None:
        """End the process as a crash would."""
        self.process.kill()
        self.process.wait(WAIT)

    def stop(self, with_signal: int = signal.SIGINT) -> int:
        """Ask the process to end and return its exit code."""
        if self.alive:
            self.process.send_signal(with_signal)
        try:
            return self.process.wait(WAIT)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"the node did not end:\n{self.log}") from None


class Inbox(Generic[Message]):
    """Messages of one topic in the order of their arrival."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._messages: list[Message] = []

    def put(self, message: Message) -> None:
        """Take a message; called from the executor's thread."""
        with self._condition:
            self._messages.append(message)
            self._condition.notify_all()

    @property
    def messages(self) -> list[Message]:
        """A copy of everything that has come."""
        with self._condition:
            return list(self._messages)

    def wait_for(
        self, condition: Callable[[Message], bool] = lambda _: True, timeout: float = WAIT, after: int = 0
    ) -> Message:
        """Wait for a message that fulfils a condition, the first ``after`` ones aside, and return it."""
        found: list[Message] = []

        def arrived() -> bool:
            found[:] = [message for message in self._messages[after:] if condition(message)][:1]
            return bool(found)

        with self._condition:
            if not self._condition.wait_for(arrived, timeout):
                last = self._messages[-1] if self._messages else "nothing"
                raise AssertionError(f"no such message in {timeout} s; {len(self._messages)} came, last: {last}")
        return found[0]

    def wait_for_count(self, count: int, timeout: float = WAIT) -> list[Message]:
        """Wait until so many messages have come and return all."""
        with self._condition:
            if not self._condition.wait_for(lambda: len(self._messages) >= count, timeout):
                raise AssertionError(f"{len(self._messages)} of {count} messages came in {timeout} s")
            return list(self._messages)


class Probe:
    """The test's own node: publishes, subscribes and calls services, spinning in a thread."""

    def __init__(self, domain_id: int) -> None:
        self.domain_id = domain_id
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self.node = Node("probe", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._thread.join(WAIT)
        self.node.destroy_node()
        self._context.try_shutdown()

    def listen(self, kind: type[Message], topic: str, qos: QoSProfile | int = 100) -> Inbox[Message]:
        """Subscribe to a topic."""
        inbox: Inbox[Message] = Inbox()
        self.node.create_subscription(kind, topic, inbox.put, qos)
        return inbox

    def publisher(self, kind: type, topic: str, qos: QoSProfile | int = 100, subscribers: int = 1) -> Publisher:
        """Return a publisher that has been matched by at least ``subscribers`` subscribers."""
        publisher = self.node.create_publisher(kind, topic, qos)
        wait_until(lambda: publisher.get_subscription_count() >= subscribers, what=lambda: f"a listener on {topic}")
        return publisher

    def call(self, kind: type, service: str, request: Any, timeout: float = WAIT) -> Any:
        """Call a service and return its answer.

        A server that was killed stays visible until its DDS lease ends, and one that has just started may be seen
        before its way back is: a request that went to either gets no answer and is sent again.
        """
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(timeout), f"service {service} did not appear in {timeout} s"
        answered: Queue[Any] = Queue()
        end = time.monotonic() + timeout
        while True:
            client.call_async(request).add_done_callback(answered.put)
            with contextlib.suppress(Empty):
                response = answered.get(timeout=RESEND_AFTER).result()
                self.node.destroy_client(client)
                return response
            assert time.monotonic() < end, f"service {service} did not answer in {timeout} s"


def wait_until(
    condition: Callable[[], bool], timeout: float = WAIT, what: Callable[[], str] = lambda: "the condition"
) -> None:
    """Wait until a condition holds that no event announces."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"{what()} did not come within {timeout} s"
        time.sleep(0.01)


__all__ = ["WAIT", "Inbox", "NodeUnderTest", "Probe", "wait_until"]
