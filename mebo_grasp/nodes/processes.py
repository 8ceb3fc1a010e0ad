"""The three nodes as processes: started together, watched, and stopped cleanly."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import yaml

from mebo_grasp.errors import MeboGraspError
from mebo_grasp.nodes.runtime import PARENT_VARIABLE

STOP_TIMEOUT = 10.0
"""Seconds that a node has to end after SIGTERM before it is killed."""

Parameters = Mapping[str, object]


class NodeProcess:
    """One node in a process of its own.

    Args:
        name: module in ``mebo_grasp.nodes`` and name of the node.
        parameters: ROS parameters by name.
        directory: where its parameter file and its log are written.
        domain_id: DDS domain; discovery is limited to this machine.
    """

    def __init__(self, name: str, parameters: Parameters, directory: Path, domain_id: int) -> None:
        self.name = name
        self.log_path = directory / f"{name}.log"
        parameter_file = directory / f"{name}.yaml"
        parameter_file.write_text(yaml.safe_dump({name: {"ros__parameters": dict(parameters)}}), encoding="utf-8")
        command = [sys.executable, "-m", f"mebo_grasp.nodes.{name}"]
        command += ["--ros-args", "--params-file", str(parameter_file)]
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain_id),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            # One BLAS thread a node: three nodes share the cores already.
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            PARENT_VARIABLE: str(os.getpid()),
        }
        with self.log_path.open("ab") as log:
            self._log_begins = log.tell()
            # A session of its own: Ctrl-C reaches the command line alone, which then stops the nodes.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def check(self) -> None:
        """Raise when the process has ended.

        Raises:
            MeboGraspError: it has; the message has the exit code and the end of its log.
        """
        code = self._process.poll()
        if code is not None:
            # A run that is continued has the log of its earlier starts in the same file.
            said = self.log_path.read_bytes()[self._log_begins :].decode("utf-8", errors="replace")
            lines = said.splitlines()[-10:]
            raise MeboGraspError(f"{self.name} ended with exit code {code}; its log says:\n" + "\n".join(lines))

    def request_stop(self) -> None:
        """Ask the process to end."""
        if self._process.poll() is None:
            # Not SIGINT: a node of an exploration in a shell's background ignores that one until it has its handler.
            self._process.terminate()

    def stop(self) -> None:
        """Wait for the process to end; kill it when it does not."""
        self.request_stop()
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class NodeGroup:
    """Node processes that live and end together. Use as a context manager."""

    def __init__(self) -> None:
        self._nodes: list[NodeProcess] = []

    def start(self, node: NodeProcess) -> None:
        """Take over a started node."""
        self._nodes.append(node)

    def check(self) -> None:
        """Raise when a node has ended.

        Raises:
            MeboGraspError: names the node and shows the end of its log.
        """
        for node in self._nodes:
            node.check()

    def __enter__(self) -> NodeGroup:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for node in self._nodes:
            node.request_stop()
        for node in self._nodes:
            node.stop()
