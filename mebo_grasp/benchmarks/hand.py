"""Prints what a trial of the simulated hand costs: ``python -m mebo_grasp.benchmarks.hand``.

Poses are drawn uniformly from the bottle's position space; ROS has no part in it. Wall time is what a user waits
for, CPU time is what counts on a shared machine. Beside the own search for epsilon stands scipy's Qhull on the
same wrench sets. Where the reference trials of Simox are at hand, their poses are tried too.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event as EventType

import numpy as np

from mebo_grasp.benchmarks.figures import EDGES, ENGINES, HAND, WARM_UP, Target, Timing, try_all
from mebo_grasp.benchmarks.hand_agreement import REFERENCE_TRIALS, bench_engines, bench_reference
from mebo_grasp.benchmarks.hand_epsilon import bench_epsilon, bench_exactness
from mebo_grasp.grasp import Grasp, GraspOutcome
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

WITH_VOLUME_ASKED = 500.0
"""Whole trials per second that hand_node's engine is asked for, volume included."""
MOST_REPEATED = 100


def bench_trials(target: TargetObject, hand: HandModel, trials: int, seed: int) -> list[Grasp]:
    """Print the cost of a trial for each engine, with and without the volume; return the last grasps."""
    space, rng = position_space(target, hand), np.random.default_rng(seed)
    poses = [space.to_pose(x) for x in rng.uniform(space.lower, space.upper, (trials, space.dimension))]
    grasps: list[Grasp] = []
    for engine in ENGINES:
        for volume in (True, False):
            settings = TrialSettings(engine=engine, cone_edges=EDGES, compute_volume=volume)
            grasps, timing = try_all(target, hand, settings, poses)
            print(f"{engine:6s} {'with' if volume else 'without'} volume: {timing.line()}")
            print_by_outcome(grasps, timing)
            if engine == "bullet" and volume:
                asked = Target("whole trials with volume per CPU second", WITH_VOLUME_ASKED)
                print(f"         {asked.verdict(len(poses) / timing.cpu.sum())}")
    return grasps


def print_by_outcome(grasps: Sequence[Grasp], timing: Timing) -> None:
    """Print the share of each outcome and what its trials cost."""
    for outcome in (GraspOutcome.COLLISION, GraspOutcome.NO_CONTACT, GraspOutcome.GRASPED):
        chosen = np.array([grasp.outcome is outcome for grasp in grasps])
        if chosen.any():
            cost = 1e3 * np.median(timing.wall[chosen])
            print(f"         {outcome.name:10s} {100 * chosen.mean():5.1f} %, ms median {cost:.3f}")
    closed = np.array([grasp.force_closure for grasp in grasps])
    if closed.any():
        cost = 1e3 * np.median(timing.wall[closed])
        print(f"         in force closure {100 * closed.mean():.1f} %, ms median {cost:.3f}")


def _share_of_work(trials: int, seed: int, begin: EventType, pipe: Connection) -> None:
    """Build a simulator, say so, wait, try poses, and send the trials per second of wall time."""
    target, hand = TargetObject.builtin("bottle"), HandModel.load(HAND)
    space = position_space(target, hand)
    points = np.random.default_rng(seed).uniform(space.lower, space.upper, (trials, 3))
    with GraspSimulator(target, hand, TrialSettings(compute_volume=False)) as simulator:
        for x in points[:WARM_UP]:
            simulator.trial(space.to_pose(x))
        pipe.send(None)
        begin.wait()
        start = time.perf_counter()
        for x in points:
            simulator.trial(space.to_pose(x))
        pipe.send(trials / (time.perf_counter() - start))


def rate_of_processes(processes: int, trials: int, seed: int) -> float:
    """Return the trials per second of some processes together, each with a simulator of its own and the same poses."""
    context = multiprocessing.get_context("spawn")
    begin, pipes, workers = context.Event(), [], []
    for _ in range(processes):
        ours, theirs = context.Pipe(duplex=False)
        workers.append(context.Process(target=_share_of_work, args=(trials, seed, begin, theirs)))
        workers[-1].start()
        pipes.append(ours)
    for pipe in pipes:
        pipe.recv()
    begin.set()
    total = sum(float(pipe.recv()) for pipe in pipes)
    for worker in workers:
        worker.join()
    return total


def bench_processes(trials: int, seed: int) -> None:
    """Print how the rate of trials grows with a second process; on a machine with other work it tells of that too."""
    # A fraction of a second would tell more of the machine than of the processes.
    rates = [rate_of_processes(count, 10 * trials, seed) for count in (1, 2)]
    print(
        f"trials per second of wall time: one process {rates[0]:.0f}, two {rates[1]:.0f} "
        f"(load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)"
    )
    print(f"  {Target('two processes over one', 1.8).verdict(rates[1] / rates[0])}")


START_PROGRAM = """
import time
start = time.perf_counter()
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
target, hand = TargetObject.builtin("bottle"), HandModel.load("icub_left")
space = position_space(target, hand)
with GraspSimulator(target, hand) as simulator:
    simulator.trial(space.to_pose((space.lower + space.upper) / 2.0))
print(time.perf_counter() - start)
"""


def bench_start() -> None:
    """Print how long it takes from the first import to the first trial, compiled code being cached."""
    seconds = []
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", START_PROGRAM], capture_output=True, text=True, check=True)
        seconds.append(float(done.stdout.split()[-1]))
    spread = f"{min(seconds):.2f} to {max(seconds):.2f} s"
    print(f"start to the first trial, {spread}: {Target('median in s', 3.0, False).verdict(float(np.median(seconds)))}")


REPEAT_PROGRAM = """
import sys
from mebo_grasp.benchmarks.hand import digest
print(digest(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
"""


def digest(engine: str, trials: int, seed: int) -> str:
    """Return a digest of all bits of some trials on the bottle."""
    target, hand = TargetObject.builtin("bottle"), HandModel.load(HAND)
    space = position_space(target, hand)
    points = np.random.default_rng(seed).uniform(space.lower, space.upper, (trials, 3))
    seen = hashlib.sha256()
    with GraspSimulator(target, hand, TrialSettings(engine="fast" if engine == "fast" else "bullet")) as simulator:
        for x in points:
            grasp = simulator.trial(space.to_pose(x))
            numbers = [grasp.quality, grasp.epsilon, grasp.volume, grasp.isotropy, *grasp.hand_posture.positions]
            for contact in grasp.contacts:
                numbers += [*contact.position, *contact.normal]
            seen.update(np.array(numbers).tobytes())
    return seen.hexdigest()


def bench_repeats(trials: int, seed: int) -> None:
    """Print whether processes started anew give the same bits."""
    for engine in ENGINES:
        found = set()
        for _ in range(3):
            command = [sys.executable, "-c", REPEAT_PROGRAM, engine, str(trials), str(seed)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found.add(done.stdout.split()[-1])
        print(f"{engine}: {trials} trials in three processes, bit-identical: {'yes' if len(found) == 1 else 'NO'}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its figures."""
    parser = argparse.ArgumentParser(description="What a trial of the simulated hand costs")
    parser.add_argument("--trials", type=int, default=500, help="poses in the bottle's position space")
    parser.add_argument("--sets", type=int, default=10_000, help="random contact sets for epsilon against Qhull")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    if options.trials < 1 or options.sets < 1 or options.seed < 0:
        parser.error("--trials and --sets must be at least 1 and --seed at least 0")
    target, hand = TargetObject.builtin("bottle"), HandModel.load(HAND)
    print(f"load average {os.getloadavg()[0]:.1f}; {HAND} on the bottle, {options.trials} poses, seed {options.seed}")
    grasps = bench_trials(target, hand, options.trials, options.seed)
    bench_epsilon(target, grasps, options.seed)
    bench_exactness(options.sets, options.seed)
    bench_reference(REFERENCE_TRIALS)
    bench_engines(options.trials, options.seed)
    bench_processes(options.trials, options.seed)
    bench_repeats(min(options.trials, MOST_REPEATED), options.seed)
    bench_start()
    print(f"load average at the end {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
