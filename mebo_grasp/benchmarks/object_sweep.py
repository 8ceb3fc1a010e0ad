"""Tries many meshes and says of each what came of it: ``python -m mebo_grasp.benchmarks.object_sweep``.

The meshes are those of the package pybullet_data: 1,000 random shapes (one is empty), a mug, a duck and a bear. Every
object gets grasps or a reason why not; a crash, a hang or a silent zero is counted and makes the exit code 1. Lines
are appended to a file as they come, and objects already in it are not tried again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.experiments.objectives.installed_files import package_folder
from mebo_grasp.grasp import GraspOutcome
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import ENGINE_NAMES, EngineName, TrialSettings
from mebo_grasp.optimization.initial_design import rng_argument

RANDOM_SHAPES = 1000
RANDOM_SCALE = 0.015
EXTRAS = {"objects/mug.obj": 1.0, "duck.obj": 0.05, "teddy2_VHACD_CHs.obj": 0.1}
"""Files of pybullet_data and the factors that bring them to the size of a hand's objects."""
HANG = 120.0
MORE = 8
"""How many times as many poses are tried before an object is said to give no grasp."""


@dataclass(frozen=True)
class SweepResult:
    """What came of one object.

    Args:
        name: its file within the data folder.
        verdict: "grasps"; "none" with a reason; "refused" with the error of loading; "crash" or "hang".
        reason: why there is no grasp; empty if there is one.
        watertight: whether the mesh is closed.
        tried, grasped, closed, collided: numbers of poses: tried, with contacts, in force closure, colliding.
        best: largest epsilon.
        build_seconds, trial_ms: to load the object and build the simulator; mean of a trial.
    """

    name: str
    verdict: str
    reason: str = ""
    watertight: bool = False
    tried: int = 0
    grasped: int = 0
    closed: int = 0
    collided: int = 0
    best: float = 0.0
    build_seconds: float = 0.0
    trial_ms: float = 0.0


def all_objects() -> dict[str, float]:
    """Return file and scale of every object of the sweep."""
    shapes = {f"random_urdfs/{i:03d}/{i:03d}.obj": RANDOM_SCALE for i in range(RANDOM_SHAPES)}
    return EXTRAS | shapes


def try_object(path: Path, name: str, scale: float, engine: EngineName, poses: int, seed: int) -> SweepResult:
    """Try poses around one object.

    Args:
        path: mesh file.
        name: name to report.
        scale: factor to metres.
        engine: engine of the trials.
        poses: number of poses, of a scrambled Halton net in the object's 6-D space; ``MORE`` times as many if none
            grasps.
        seed: of the net.
    """
    hand, begun = HandModel.load("icub_left"), time.perf_counter()
    try:
        target = TargetObject.from_file(path, scale)
    except InvalidObjectError as error:
        return SweepResult(name, "refused", str(error))
    space = pose_space_6d(target, hand)
    net = qmc.Halton(space.dimension, **rng_argument(qmc.Halton, np.random.default_rng(seed)))
    with GraspSimulator(target, hand, TrialSettings(engine=engine, compute_volume=False)) as simulator:
        built, outcomes, closed, best = time.perf_counter() - begun, Counter[GraspOutcome](), 0, 0.0
        for count in (poses, (MORE - 1) * poses):
            for x in qmc.scale(net.random(count), space.lower, space.upper):
                grasp = simulator.trial(space.to_pose(x))
                outcomes[grasp.outcome] += 1
                closed += grasp.force_closure
                best = max(best, grasp.epsilon)
            if outcomes[GraspOutcome.GRASPED]:
                break
    tried, grasped, collided = outcomes.total(), outcomes[GraspOutcome.GRASPED], outcomes[GraspOutcome.COLLISION]
    reason = "" if grasped else f"{collided} of {tried} poses collide, {tried - collided} touch nothing"
    spent = time.perf_counter() - begun - built
    return SweepResult(
        name,
        "grasps" if grasped else "none",
        reason,
        bool(target.mesh.is_watertight),
        tried,
        grasped,
        closed,
        collided,
        best,
        built,
        1e3 * spent / tried,
    )


Attempt = Callable[[Path, str, float, EngineName, int, int], SweepResult]
"""``try_object``, or what stands for it."""


def _work(pipe: Connection, attempt: Attempt, folder: Path, engine: EngineName, poses: int, seed: int) -> None:
    """Answer one object after the other until told None."""
    while (task := pipe.recv()) is not None:
        name, scale = task
        try:
            result = attempt(folder / name, name, scale, engine, poses, seed)
        except Exception as error:  # whatever it is, it is a crash to be reported
            result = SweepResult(name, "crash", f"{type(error).__name__}: {error}")
        pipe.send(result)


class Worker:
    """A process that tries objects, so that a crash or a hang ends it and not the sweep."""

    def __init__(self, folder: Path, engine: EngineName, poses: int, seed: int, attempt: Attempt = try_object) -> None:
        self._arguments = (attempt, folder, engine, poses, seed)
        self._process: multiprocessing.process.BaseProcess | None = None

    def try_object(self, name: str, scale: float, patience: float) -> SweepResult:
        """Return what came of an object, at the latest after ``patience`` seconds."""
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_work, args=(theirs, *self._arguments), daemon=True)
            self._process.start()
            theirs.close()
        self._pipe.send((name, scale))
        try:
            if self._pipe.poll(patience):
                result: SweepResult = self._pipe.recv()
                return result
            verdict, reason = "hang", f"no answer within {patience:.0f} s"
        except EOFError:
            self._process.join(5.0)
            verdict, reason = "crash", f"the process ended with code {self._process.exitcode}"
        self.stop()
        return SweepResult(name, verdict, reason)

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None


def sweep(worker: Worker, objects: dict[str, float], out: Path, patience: float) -> Iterator[SweepResult]:
    """Try the objects that a file does not tell of yet, append what came of each, and yield all."""
    done = [SweepResult(**json.loads(line)) for line in out.read_text().splitlines()] if out.exists() else []
    known = {result.name for result in done}
    yield from (result for result in done if result.name in objects)
    with out.open("a") as stream:
        for name, scale in objects.items():
            if name not in known:
                result = worker.try_object(name, scale, patience)
                stream.write(json.dumps(asdict(result)) + "\n")
                stream.flush()
                yield result


def summary(results: Sequence[SweepResult]) -> str:
    """Return what came of all objects, with every one that gave no grasp."""
    verdicts = Counter(result.verdict for result in results)
    lines = [f"{len(results)} objects: " + ", ".join(f"{count} {name}" for name, count in verdicts.most_common())]
    tried = [result for result in results if result.tried]
    if tried:
        closed = sum(result.closed > 0 for result in tried)
        lines.append(f"{closed} have a grasp in force closure, {sum(r.watertight for r in tried)} are watertight")
        for label, values in (
            ("seconds to load and build", [result.build_seconds for result in tried]),
            ("ms a trial", [result.trial_ms for result in tried]),
            ("best epsilon", [result.best for result in tried]),
        ):
            low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
            lines.append(f"{label}: median {middle:.3g}, 5-95 % {low:.3g} to {high:.3g}, largest {max(values):.3g}")
    lines += [f"  {r.name}: {r.verdict}: {r.reason}" for r in results if r.verdict != "grasps"]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sweep; the exit code is 1 after a crash or a hang."""
    parser = argparse.ArgumentParser(description="Tries the meshes of pybullet_data")
    parser.add_argument("--count", type=int, default=RANDOM_SHAPES + len(EXTRAS), help="objects, evenly chosen")
    parser.add_argument("--poses", type=int, default=64, help="poses an object (default: 64)")
    parser.add_argument("--engine", default="bullet", choices=ENGINE_NAMES)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/object_sweep.jsonl"), help="file to continue")
    options = parser.parse_args(arguments)
    if options.count < 1 or options.poses < 1 or options.seed < 0:
        parser.error("--count and --poses must be at least 1, --seed at least 0")
    objects = list(all_objects().items())
    chosen = np.unique(np.linspace(0, len(objects) - 1, min(options.count, len(objects))).round().astype(int))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    worker = Worker(package_folder("pybullet_data"), options.engine, options.poses, options.seed)
    try:
        results = list(sweep(worker, dict(objects[i] for i in chosen), options.out, HANG))
    finally:
        worker.stop()
    sys.stdout.write(summary(results) + "\n")
    return 1 if any(result.verdict in ("crash", "hang") for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
