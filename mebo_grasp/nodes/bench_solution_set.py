"""Measures the solution set node over real DDS: ``python -m mebo_grasp.nodes.bench_solution_set``.

Fills archives as ``benchmarks.solutions`` does, starts the node on each, and prints with spread: the time until it
answers, the answer time of ``get_best_grasp`` (k = 10) under both rules in random scenes, the time from
``occlusions`` to ``best_grasp`` and to ``solution_set``, the time from a trial to its being served, and memory.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality, OcclusionArray
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet

from mebo_grasp.benchmarks.solutions import OBJECT, fill, in_own_process, make_scene, make_trials
from mebo_grasp.grasp import FloatArray, Pose, StampedGrasp
from mebo_grasp.nodes import qos
from mebo_grasp.nodes.bench_nodes import Bench, memory, processor_seconds, spread
from mebo_grasp.nodes.domain import private_domain
from mebo_grasp.nodes.processes import NodeGroup, NodeProcess
from mebo_grasp.solutions.occlusion import Box, Occlusion
from msg_adapters.grasp import to_grasp_quality_msg
from msg_adapters.occlusion import to_occlusion_msg


def scenes_of(count: int, shapes: int, seed: int) -> list[list[OcclusionMsg]]:
    """Return random scenes as messages."""
    rng = np.random.default_rng(seed)
    return [[to_occlusion_msg(o, OBJECT) for o in make_scene(shapes, rng)] for _ in range(count)]


def bench_service(bench: Bench, node: NodeProcess, scenes: Sequence[list[OcclusionMsg]], name: str, rule: int) -> None:
    """Time ``get_best_grasp`` in each scene once.

    The processor time of node and caller is what other programs on the machine disturb least: on an idle one the
    answer takes as long, and the way through DDS.
    """
    requests = [GetBestGrasp.Request(occlusions=scene, max_grasps=10, rule=rule) for scene in scenes]

    def clocks() -> FloatArray:
        return np.array([time.perf_counter(), processor_seconds(node) + time.process_time()])

    times = bench.time_calls(GetBestGrasp, "get_best_grasp", requests, clocks)
    spread(f"get_best_grasp, {name}, k = 10", times[:, 0])
    spread("  of it processor time of node and caller", times[:, 1])


def bench_topic(bench: Bench, scenes: Sequence[list[OcclusionMsg]]) -> None:
    """Time the way from new occlusions to the topics that follow from them.

    A scene that leaves the best grasp as it is publishes no new one, so every other array blocks everything.
    """
    seen: dict[str, list[float]] = {"best_grasp": [], "solution_set": []}

    def note(topic: str) -> None:
        seen[topic].append(time.perf_counter())

    bench.node.create_subscription(PoseStamped, "best_grasp", lambda _: note("best_grasp"), qos.LATCHED)
    bench.node.create_subscription(SolutionSetMsg, "solution_set", lambda _: note("solution_set"), qos.LATCHED)
    publisher = bench.node.create_publisher(OcclusionArray, "occlusions", qos.LATCHED)
    bench.wait(lambda: publisher.get_subscription_count() > 0, "the node")
    bench.wait(lambda: all(seen.values()), "the latched topics")
    room = Occlusion("room", Box((4.0, 4.0, 4.0)), Pose.identity())
    blocked = [to_occlusion_msg(room, OBJECT)]
    times: dict[str, list[float]] = {topic: [] for topic in seen}
    for array in (array for scene in scenes for array in (blocked, scene)):
        for moments in seen.values():
            moments.clear()
        start = time.perf_counter()
        publisher.publish(OcclusionArray(occlusions=array))
        bench.wait(lambda: all(seen.values()), "the topics that follow from occlusions")
        for topic, moments in seen.items():
            times[topic].append(1000 * (moments[0] - start))
    for topic, values in times.items():
        spread(f"occlusions to {topic}", np.array(values))
    publisher.publish(OcclusionArray())


def bench_trials(bench: Bench, count: int, seed: int) -> None:
    """Time the way from a trial on ``grasp_quality`` to the best grasp that it is."""
    best: list[PoseStamped] = []
    bench.node.create_subscription(PoseStamped, "best_grasp", best.append, qos.LATCHED)
    publisher = bench.node.create_publisher(GraspQuality, "grasp_quality", qos.QUALITIES)
    bench.wait(lambda: publisher.get_subscription_count() > 0 and bool(best), "the node")
    times = []
    first_ns = time.time_ns()
    for number, stamped in enumerate(make_trials(count, np.random.default_rng(seed))):
        message = to_grasp_quality_msg(StampedGrasp(first_ns + number, stamped.grasp), OBJECT)
        message.hand = "icub_left"
        message.hand_posture.name, message.hand_posture.position = [], []
        message.quality = 10.0 + number  # better than all before, so that its coming can be seen
        best.clear()
        start = time.perf_counter()
        publisher.publish(message)
        bench.wait(lambda: bool(best), "the new best grasp")
        times.append(1000 * (time.perf_counter() - start))
    spread("a new best trial to best_grasp", np.array(times))


def bench_node(folder: Path, stored: int, count: int, shapes: int, seed: int) -> None:
    """Start a node on an archive of so many grasps and measure everything."""
    folder = folder / str(stored)
    folder.mkdir()
    database = folder / "bench.db"
    in_own_process(fill, database, stored)
    scenes = scenes_of(count, shapes, seed)
    with private_domain() as domain_id, NodeGroup() as nodes:
        start = time.perf_counter()
        # The grasps are of benchmarks.solutions' synthetic hand: it arrives along its own z.
        parameters = {"object": OBJECT, "database": str(database), "approach_axis": [0.0, 0.0, 1.0]}
        node = NodeProcess("solution_set_node", parameters, folder, domain_id)
        nodes.start(node)
        bench = Bench(domain_id)
        bench.time_calls(GetSolutionSet, "get_solution_set", [GetSolutionSet.Request()])
        print(f"{stored} stored: {time.perf_counter() - start:.2f} s from start of the process to an answer")
        for line in node.log_path.read_text(encoding="utf-8").splitlines():
            if "opened in" in line:
                print("  " + line.split("]: ")[-1])
        rules = GetBestGrasp.Request
        by_hand = f"{shapes} shapes, hand rule, approach 10 cm"
        bench_service(bench, node, scenes, f"{shapes} shapes, TCP rule", rules.RULE_TCP)
        bench_service(bench, node, scenes, by_hand, rules.RULE_HAND)
        bench_topic(bench, scenes[: max(1, count // 4)])
        bench_trials(bench, count, seed)
        print(f"solution_set_node with {stored} stored: {memory(node):.0f} MB resident")
        bench.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--stored", type=int, nargs="+", default=[10_000, 1_000_000])
    parser.add_argument("--count", type=int, default=300, help="samples of each figure")
    parser.add_argument("--shapes", type=int, default=20, help="occluding shapes in a scene")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for stored in options.stored:
            load = f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
            print(f"over DDS, hand rule by default; {load}")
            bench_node(Path(name), stored, options.count, options.shapes, options.seed)


if __name__ == "__main__":
    main()
