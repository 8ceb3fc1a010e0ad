"""How fast the archive answers, at any size: ``python -m mebo_grasp.benchmarks.solutions``.

Fills an archive with grasps of a synthetic hand of 18 capsules around a bottle, then asks for the best
grasps in random scenes of boxes, spheres, cylinders and cones, each scene once, and prints the times
beside those of a straightforward scan (``solution_scan``), whose answers must be the same. For each kind of
question there are two lines of times: wall clock, and processor time of the asking thread, which other
programs on the machine disturb less.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from mebo_grasp.benchmarks.solution_scan import scan_by_hand, scan_by_tcp
from mebo_grasp.grasp import FloatArray, Grasp, GraspContact, GraspOutcome, HandPosture, Pose, StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Shape,
    Sphere,
)
from mebo_grasp.solutions.trial_store import TrialStore

Answer = TypeVar("Answer")

OBJECT = "bottle"
FIRST_STAMP = 1_700_000_000_000_000_000
POSTURES = 500
TABLE = Occlusion("table", Box((4.0, 4.0, 2.0)), Pose(np.array([0.0, 0.0, -1.11])))


def make_hands(rng: np.random.Generator) -> list[HandVolume]:
    """Return hands of 18 capsules (a palm of three, five fingers of three) with random flexion."""
    return [_make_hand(rng.uniform(0.2, 1.2, 5)) for _ in range(POSTURES)]


def _make_hand(flexions: FloatArray) -> HandVolume:
    # The TCP is in front of the palm and z points away from it; the fingers curl towards z.
    starts = [[-0.03, y, -0.03] for y in (-0.025, 0.0, 0.025)]
    ends = [[0.03, y, -0.03] for y in (-0.025, 0.0, 0.025)]
    radii = [0.015] * 3
    for finger, flexion in enumerate(flexions):
        point = np.array([0.04, -0.04 + 0.02 * finger, -0.03])
        for joint, length in enumerate((0.035, 0.025, 0.02), start=1):
            angle = flexion * joint
            tip = point + length * np.array([np.cos(angle), 0.0, np.sin(angle)])
            starts.append(list(point))
            ends.append(list(tip))
            radii.append(0.0065)
            point = tip
    return HandVolume(np.array(starts), np.array(ends), np.array(radii))


def make_trials(count: int, rng: np.random.Generator) -> Iterator[StampedGrasp]:
    """Yield grasps around a bottle 20 cm high, the hand within 60 degrees of facing its axis."""
    angles = rng.uniform(-np.pi, np.pi, count)
    radii = rng.uniform(0.03, 0.08, count)
    heights = rng.uniform(-0.1, 0.1, count)
    tilts = rng.normal(0.0, 0.5, (count, 3))
    # Grasps are best in the middle of the bottle and near to it, as occlusions there matter most.
    qualities = np.clip(
        0.8 * np.exp(-((heights / 0.06) ** 2) - ((radii - 0.045) / 0.02) ** 2) + rng.normal(0.0, 0.05, count),
        1e-3,
        None,
    )
    contact = GraspContact("finger", np.array([0.03, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    posture = HandPosture(tuple(f"joint_{i}" for i in range(16)), (0.5,) * 16)
    for i in range(count):
        position = [radii[i] * np.cos(angles[i]), radii[i] * np.sin(angles[i]), heights[i]]
        pose = Pose.from_rpy(position, [tilts[i, 0], -np.pi / 2 + tilts[i, 1], angles[i] + tilts[i, 2]])
        yield StampedGrasp(
            FIRST_STAMP + i,
            Grasp(
                pose,
                GraspOutcome.GRASPED,
                float(qualities[i]),
                force_closure=True,
                contacts=(contact,) * 6,
                hand_posture=posture,
                object_id=OBJECT,
                hand="synthetic",
            ),
        )


def make_scene(count: int, rng: np.random.Generator) -> tuple[Occlusion, ...]:
    """Return random shapes of 2 to 10 cm, within 20 cm of the object."""
    shapes: list[Shape] = []
    for kind in rng.integers(0, 4, count):
        a, b, c = rng.uniform(0.02, 0.1, 3)
        shapes.append([Box((a, b, c)), Sphere(a / 2), Cylinder(a, b / 2), Cone(a, b / 2)][kind])
    return tuple(
        Occlusion(f"shape {i}", shape, Pose.from_rpy(rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3)))
        for i, shape in enumerate(shapes)
    )


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


class Times:
    """Wall-clock and processor times of calls, seconds."""

    def __init__(self) -> None:
        self.wall: list[float] = []
        self.processor: list[float] = []

    def call(self, ask: Callable[[], Answer]) -> Answer:
        """Call, keep the times, return the answer."""
        wall, processor = time.perf_counter(), time.thread_time()
        answer = ask()
        self.wall.append(time.perf_counter() - wall)
        self.processor.append(time.thread_time() - processor)
        return answer

    def say(self, name: str, note: str = "") -> None:
        """Print median, 99th percentile and greatest."""
        note = f"of {len(self.wall)}  {note}"
        for kind, seconds in (("wall", self.wall), ("cpu", self.processor)):
            p50, p99, worst = np.percentile(np.array(seconds) * 1e3, [50, 99, 100])
            figures = f"p50 {p50:8.3f}  p99 {p99:8.3f}  max {worst:8.3f} ms"
            _say(f"  {name if kind == 'wall' else '':<52} {kind:<4} {figures}  {note}")
            note = ""


def _memory() -> float:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024.0
    return float("nan")


def _ask_scenes(archive: SolutionArchive, name: str, scenes: Sequence[tuple[Occlusion, ...]], **query: object) -> None:
    times, found, blocked = Times(), 0, 0
    for scene in scenes:
        asked = BestGraspQuery(scene, **query)  # type: ignore[arg-type]
        answer = times.call(partial(archive.best, asked))
        found += len(answer.grasps)
        blocked += answer.occluded
    times.say(name, f"({found / len(scenes):.1f} found, {blocked / len(scenes):.0f} blocked a question)")


def measure_questions(archive: SolutionArchive, questions: int, shapes: int, rng: np.random.Generator) -> None:
    """Print the times of questions in random scenes."""
    scenes = [make_scene(shapes, rng) for _ in range(questions)]
    everywhere = [(Occlusion("room", Box((2.0, 2.0, 2.0)), Pose.identity()),)] * 20
    tcp, hand = BlockingRule.TCP, BlockingRule.HAND
    _ask_scenes(archive, f"TCP rule, {shapes} shapes, k = 10", scenes, max_grasps=10, rule=tcp)
    _ask_scenes(
        archive, f"TCP rule, {shapes} shapes, k = 10, 4 cm apart", scenes,
        max_grasps=10, rule=tcp, min_diversity=0.04,
    )  # fmt: skip
    _ask_scenes(archive, "TCP rule, all blocked by one box", everywhere, max_grasps=10, rule=tcp)
    _ask_scenes(
        archive, "no shapes, k = 10 of which fewer exist (40 cm)", [()] * 20,
        max_grasps=10, min_diversity=0.4,
    )  # fmt: skip
    for few in (3, shapes):
        some = [scene[:few] for scene in scenes]
        _ask_scenes(
            archive, f"hand rule, {few} shapes, approach 10 cm, k = 10", some,
            max_grasps=10, rule=hand, approach_length=0.1,
        )  # fmt: skip
    on_table = [(TABLE, *scene[:3]) for scene in scenes]
    _ask_scenes(
        archive, "hand rule, table and 3 shapes, 10 cm, k = 10", on_table,
        max_grasps=10, rule=hand, approach_length=0.1,
    )  # fmt: skip
    _ask_scenes(archive, "hand rule, all blocked by one box", everywhere, max_grasps=10, rule=hand)


def measure_scan(path: Path, scenes: int, shapes: int) -> None:
    """Print the times of a straightforward scan over the same grasps, and compare the answers with its own."""
    rng = np.random.default_rng(3)
    store = TrialStore(path, OBJECT)
    stored = store.load(with_volumes=True)
    store.close()
    hand_volume, approach = partial(hand_of, make_hands(np.random.default_rng(1))), np.array([0.0, 0.0, -0.1])
    scan_by_hand(stored, (), approach, 1)  # makes the compiled code
    by_tcp, by_hand, equal = Times(), Times(), 0
    with SolutionArchive(path, OBJECT, hand_volume=hand_volume) as archive:
        for _ in range(scenes):
            scene = make_scene(shapes, rng)
            answers = (
                by_tcp.call(partial(scan_by_tcp, stored, scene, 10)),
                by_hand.call(partial(scan_by_hand, stored, scene, approach, 10)),
            )
            queries = (
                BestGraspQuery(scene, max_grasps=10),
                BestGraspQuery(scene, max_grasps=10, rule=BlockingRule.HAND, approach_length=0.1),
            )
            for answer, query in zip(answers, queries, strict=True):
                equal += np.array_equal(answer, [s.grasp.quality for s in archive.best(query).grasps])
    by_tcp.say(f"straightforward scan, TCP rule, {shapes} shapes, k = 10")
    by_hand.say(f"straightforward scan, hand rule, {shapes} shapes, k = 10")
    _say(f"  {equal} of {2 * scenes} answers equal those of the scan")


def hand_of(hands: list[HandVolume], grasp: Grasp) -> HandVolume:
    """Return one of the hands, always the same for a grasp."""
    return hands[int(abs(grasp.T_object_tcp.position[0]) * 1e9) % POSTURES]


def fill(path: Path, stored: int) -> None:
    """Make an archive."""
    rng = np.random.default_rng(1)
    hand_volume = partial(hand_of, make_hands(rng))
    begin = time.perf_counter()
    with SolutionArchive(path, OBJECT, hand_volume=hand_volume) as archive:
        archive.add_many(make_trials(stored, rng))
    _say(f"  filled in {time.perf_counter() - begin:.1f} s, {path.stat().st_size / 1e6:.0f} MB on disk")


def measure(path: Path, stored: int, questions: int, shapes: int) -> None:
    """Open an archive and print what everything takes."""
    rng = np.random.default_rng(2)
    hand_volume = partial(hand_of, make_hands(np.random.default_rng(1)))
    SolutionArchive(":memory:", OBJECT, hand_volume=hand_volume).close()  # loads the compiled code
    gc.collect()
    gc.freeze()  # as the node does: a full collection takes longer than any question
    before, wall, processor = _memory(), time.perf_counter(), time.process_time()
    archive = SolutionArchive(path, OBJECT, hand_volume=hand_volume)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    _say(
        f"  opened in {wall:.2f} s ({processor:.2f} s of processor time, all threads); holds "
        f"{_memory():.0f} MB, {before:.0f} MB of them before; "
        f"peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"
    )
    with archive:
        times = Times()
        for trial in make_trials(questions, rng):
            times.call(partial(archive.add, _shifted(trial, stored)))
        times.say("add a trial")
        measure_questions(archive, questions, shapes, rng)
        _say(f"  peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


def _shifted(trial: StampedGrasp, stored: int) -> StampedGrasp:
    return StampedGrasp(trial.stamp_ns + stored, trial.grasp)


def in_own_process(task: Callable[..., None], *arguments: object) -> None:
    """Run a part by itself, so that memory is that of the part."""
    process = multiprocessing.get_context("spawn").Process(target=task, args=arguments)
    process.start()
    process.join()
    if process.exitcode != 0:
        raise SystemExit(f"{task.__name__} failed with exit code {process.exitcode}")


def main() -> None:
    """Measure and print."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--stored", type=int, nargs="+", default=[10_000, 1_000_000])
    parser.add_argument("--questions", type=int, default=300, help="questions of each kind")
    parser.add_argument("--shapes", type=int, default=20, help="occluding shapes in a scene")
    options = parser.parse_args()
    if min(options.questions, options.shapes, *options.stored) < 1:
        parser.error("--stored, --questions and --shapes must be at least 1")
    for stored in options.stored:
        _say(
            f"{stored} stored grasps, {options.shapes} shapes, {options.questions} questions; "
            f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.db"
            in_own_process(fill, path, stored)
            in_own_process(measure, path, stored, options.questions, options.shapes)
            # Of a million grasps the scan by hand takes some ten seconds a scene.
            scans = min(options.questions, 20 if stored <= 100_000 else 5)
            in_own_process(measure_scan, path, scans, options.shapes)


if __name__ == "__main__":
    main()
