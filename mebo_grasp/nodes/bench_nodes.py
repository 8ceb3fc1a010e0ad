"""Measures the nodes over real DDS: ``python -m mebo_grasp.nodes.bench_nodes``.

Prints, with spread: the overhead of a trial over ROS (from candidate to quality, less the simulator's own
time), the answer time of ``get_best_grasp`` with 10,000 stored trials, the answer time of the optimizer's
services while it computes, and the memory of each node.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from mebo_grasp_interfaces.srv import GetBestGrasp
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from mebo_grasp.grasp import FloatArray, Grasp, GraspOutcome, Pose, StampedGrasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes import qos
from mebo_grasp.nodes.domain import private_domain
from mebo_grasp.nodes.processes import NodeGroup, NodeProcess
from mebo_grasp.nodes.runtime import forget_garbage
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.occlusion import Box, Occlusion
from msg_adapters.occlusion import to_occlusion_msg
from msg_adapters.pose import to_pose_stamped_msg
from msg_adapters.time import from_time_msg

OBJECT = "bottle"
STORED = 10_000
TIMEOUT = 60.0


class Bench:
    """A node of the bench's own, spun only while it waits, so that what it measures is not its own thread."""

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self.node = Node("bench", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        forget_garbage()

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Spin until a condition holds."""
        end = time.monotonic() + TIMEOUT
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f"{what} did not come within {TIMEOUT:.0f} s")
            self.spin_once(0.1)

    def spin_once(self, timeout: float) -> None:
        """Take a message, or wait some seconds for one."""
        self._executor.spin_once(timeout_sec=timeout)

    def time_calls(
        self, kind: Any, service: str, requests: list[Any], clock: Callable[[], Any] = time.perf_counter
    ) -> FloatArray:
        """Call a service once a request; return milliseconds, shape (n,), or (n, c) if the clock tells c times."""
        client = self.node.create_client(kind, service)
        self.wait(client.service_is_ready, f"service {service}")
        times = []
        for request in requests:
            start = clock()
            future = client.call_async(request)
            self.wait(future.done, f"answer of {service}")
            times.append(1000 * (clock() - start))
        return np.array(times)

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


def spread(name: str, values: FloatArray, unit: str = "ms") -> None:
    """Print the distribution of a figure."""
    low, median, high, last = np.percentile(values, [5, 50, 95, 99])
    print(
        f"{name}: median {median:.2f} {unit}, 5 % {low:.2f}, 95 % {high:.2f}, 99 % {last:.2f}, "
        f"max {values.max():.2f} ({len(values)} samples)"
    )


def processor_seconds(node: NodeProcess) -> float:
    """Return the processor time that all threads of a node have taken so far, as Linux accounts it."""
    nanoseconds = 0
    for task in Path(f"/proc/{node.pid}/task").iterdir():
        nanoseconds += int((task / "schedstat").read_text(encoding="ascii").split()[0])
    return nanoseconds / 1e9


def memory(node: NodeProcess) -> float:
    """Return the resident memory of a node, MB (10^6 bytes), as Linux accounts it."""
    for line in Path(f"/proc/{node.pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise ValueError(f"no memory figure for process {node.pid}")


def bench_hand(domain_id: int, folder: Path, count: int, seed: int) -> None:
    """Send random candidates one after another and time their answers."""
    space = position_space(TargetObject.builtin(OBJECT), HandModel.load("icub_left"))
    rng = np.random.default_rng(seed)
    with NodeGroup() as nodes:
        hand = NodeProcess("hand_node", {"object": OBJECT}, folder, domain_id)
        nodes.start(hand)
        bench = Bench(domain_id)
        answers: list[GraspQuality] = []
        bench.node.create_subscription(GraspQuality, "grasp_quality", answers.append, qos.QUALITIES)
        candidates = bench.node.create_publisher(PoseStamped, "candidate_pose", qos.CANDIDATES)
        bench.wait(lambda: candidates.get_subscription_count() > 0, "the hand")
        whole, own = [], []
        for number in range(1, count + 1):
            pose = space.to_pose(rng.uniform(space.lower, space.upper))
            message = to_pose_stamped_msg(number, OBJECT, pose)
            start = time.perf_counter()
            candidates.publish(message)
            bench.wait(lambda n=number: len(answers) >= n, "an answer")  # type: ignore[misc]
            whole.append(1000 * (time.perf_counter() - start))
            took = answers[-1].computation_time
            own.append(1000 * took.sec + took.nanosec / 1e6)
        spread("hand: candidate to quality over ROS", np.array(whole))
        spread("hand: the simulator's share", np.array(own))
        spread("hand: overhead of ROS", np.array(whole) - np.array(own))
        print(f"hand_node: {memory(hand):.0f} MB resident")
        bench.close()


def fill_archive(path: Path, count: int, seed: int) -> None:
    """Store random grasps, as many as asked."""
    rng = np.random.default_rng(seed)
    with SolutionArchive(path, OBJECT) as archive:
        for stamp in range(count):
            pose = Pose.from_rpy(rng.uniform(-0.1, 0.1, 3), rng.uniform(-1.0, 1.0, 3))
            quality = float(rng.uniform(0.01, 1.0))
            archive.add(StampedGrasp(stamp, Grasp(pose, GraspOutcome.GRASPED, quality, quality, object_id=OBJECT)))


def bench_best_grasp(domain_id: int, folder: Path, count: int, seed: int) -> None:
    """Time ``get_best_grasp`` under random boxes, up to ten grasps an answer."""
    database = folder / "bench.db"
    fill_archive(database, STORED, seed)
    rng = np.random.default_rng(seed)
    requests = []
    for _ in range(count):
        shapes = [
            Occlusion(f"box {i}", Box(tuple(rng.uniform(0.02, 0.2, 3))), Pose(rng.uniform(-0.1, 0.1, 3)))
            for i in range(3)
        ]
        messages = [to_occlusion_msg(shape, OBJECT) for shape in shapes]
        requests.append(GetBestGrasp.Request(occlusions=messages, max_grasps=1))
    with NodeGroup() as nodes:
        parameters = {"object": OBJECT, "database": str(database)}
        archive = NodeProcess("solution_set_node", parameters, folder, domain_id)
        nodes.start(archive)
        bench = Bench(domain_id)
        times = bench.time_calls(GetBestGrasp, "get_best_grasp", requests)
        spread(f"get_best_grasp, {STORED} stored, 3 boxes, over ROS", times)
        print(f"solution_set_node: {memory(archive):.0f} MB resident")
        bench.close()


class InstantHand(threading.Thread):
    """Answers candidates at once, so that the optimizer never waits; spins in a thread of its own."""

    def __init__(self, domain_id: int) -> None:
        super().__init__(daemon=True)
        self._bench = Bench(domain_id)
        self._publisher = self._bench.node.create_publisher(GraspQuality, "grasp_quality", qos.QUALITIES)
        self._bench.node.create_subscription(PoseStamped, "candidate_pose", self._answer, qos.CANDIDATES)
        self._bench.node.create_subscription(ExplorationStatus, "exploration_status", self._on_status, qos.LATCHED)
        self._stopping = threading.Event()
        self.evaluations = 0
        self.status_gaps: list[float] = []

    def _answer(self, candidate: PoseStamped) -> None:
        point = candidate.pose.position
        message = GraspQuality(header=candidate.header, tcp_pose=candidate.pose, object_id=OBJECT)
        message.quality = message.epsilon = float(np.sin(20 * point.x) + np.cos(30 * point.z) + 2 * point.y)
        self._publisher.publish(message)

    def _on_status(self, status: ExplorationStatus) -> None:
        self.evaluations = status.evaluations
        stamp = from_time_msg(status.header.stamp)
        self.status_gaps.append((time.time_ns() - stamp) / 1e6)

    def run(self) -> None:
        """Spin until told to stop."""
        while not self._stopping.is_set():
            self._bench.spin_once(0.05)

    def stop(self) -> None:
        """End the thread and leave the domain."""
        self._stopping.set()
        self.join()
        self._bench.close()


def bench_optimizer(domain_id: int, folder: Path, count: int, method: str) -> None:
    """Time the optimizer's services and status topic while it computes in 6-D, about 250 trials in."""
    parameters = {"object": OBJECT, "space": "pose", "budget": 100_000, "method": method}
    with NodeGroup() as nodes:
        optimizer = NodeProcess("optimizer_node", parameters, folder, domain_id)
        nodes.start(optimizer)
        bench = Bench(domain_id)
        hand = InstantHand(domain_id)
        hand.start()
        bench.wait(lambda: hand.evaluations >= 200, "200 trials")
        hand.status_gaps.clear()
        began, start = hand.evaluations, time.perf_counter()
        # Refused while exploring, so it changes nothing; its answer takes the same way as any other.
        times = bench.time_calls(Trigger, "/optimizer_node/start", [Trigger.Request()] * count)
        bench.wait(lambda: hand.evaluations >= 300, "300 trials")
        seconds = time.perf_counter() - start
        spread(f"optimizer ({method}): service while it computes", times)
        spread(f"optimizer ({method}): status from stamp to subscriber", np.array(hand.status_gaps))
        done = hand.evaluations - began
        print(
            f"optimizer ({method}): {1000 * seconds / done:.1f} ms a trial, "
            f"{3000 * seconds / done:.0f} ms a batch of 3, all in, "
            f"at {began} to {hand.evaluations} trials in 6-D; {memory(optimizer):.0f} MB resident"
        )
        hand.stop()
        bench.close()


def main() -> None:
    """Run every measurement."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--count", type=int, default=1000, help="samples of each figure")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    options = parser.parse_args()
    print(f"nodes over DDS; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with private_domain() as domain_id, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench_hand(domain_id, folder, options.count, options.seed)
        bench_best_grasp(domain_id, folder, options.count, options.seed)
        bench_optimizer(domain_id, folder, options.count, options.method)


if __name__ == "__main__":
    main()
