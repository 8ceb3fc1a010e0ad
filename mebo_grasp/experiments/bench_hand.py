"""Prints what a trial of the simulated hand costs: ``python -m mebo_grasp.experiments.bench_hand``.

Poses are drawn uniformly from the bottle's position space; ROS has no part in it. Wall time is what a user waits
for, CPU time is what counts on a shared machine. Beside the own search for epsilon stands scipy's Qhull on the
same wrench sets. Where the reference trials of Simox are at hand, their poses are tried too.
"""

from __future__ import annotations

import argparse
import csv
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event as EventType
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import spearmanr

from mebo_grasp.grasp import FloatArray, Grasp, GraspOutcome, Pose
from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.icub_meshes import meshes_folder
from mebo_grasp.grasping.metrics import simox
from mebo_grasp.grasping.metrics.chosen import FACES_SEED
from mebo_grasp.grasping.pose_space import pose_space_6d, position_space
from mebo_grasp.grasping.quality import torque_length
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import EngineName, TrialSettings

T = TypeVar("T")
R = TypeVar("R")

ENGINES: tuple[EngineName, ...] = ("bullet", "fast")
HAND = "icub_left"
WARM_UP = 30
MOST_HULLS = 60
"""Wrench sets given to Qhull as well; it is slow."""
REPETITIONS = 40
QHULL_REPETITIONS = 4
EDGES = 8
REFERENCE_TRIALS = Path(__file__).parents[3] / "shared" / "data" / "simox_bottle"
REFERENCE_FRICTION = 1.0
"""The effective coefficient behind the Simox figures: its cone edges stand at 45 degrees."""


@dataclass(frozen=True)
class Timing:
    """Seconds of each call: wall and CPU, shape (n,)."""

    wall: FloatArray
    cpu: FloatArray

    def line(self) -> str:
        """Rates and the spread of the wall time."""
        low, middle, high = 1e3 * np.quantile(self.wall, [0.05, 0.5, 0.95])
        n = len(self.wall)
        return (
            f"{n / self.wall.sum():7.0f}/s wall, {n / self.cpu.sum():7.0f}/s CPU; "
            f"ms median {middle:7.3f}, 5-95 % {low:.3f} to {high:.3f}; mean wall {1e3 * self.wall.mean():.3f}, "
            f"CPU {1e3 * self.cpu.mean():.3f}"
        )


def timed(call: Callable[[T], R], inputs: Sequence[T]) -> tuple[list[R], Timing]:
    """Call with each input in turn and time each call."""
    results, wall, cpu = [], np.empty(len(inputs)), np.empty(len(inputs))
    for i, value in enumerate(inputs):
        cpu_start, wall_start = time.process_time(), time.perf_counter()
        results.append(call(value))
        wall[i], cpu[i] = time.perf_counter() - wall_start, time.process_time() - cpu_start
    return results, Timing(wall, cpu)


def try_all(
    target: TargetObject, hand: HandModel, settings: TrialSettings, poses: Sequence[Pose]
) -> tuple[list[Grasp], Timing]:
    """Try all poses, after a warm-up on the first ones that is not timed."""
    with GraspSimulator(target, hand, settings) as simulator:
        for pose in poses[:WARM_UP]:
            simulator.trial(pose)
        return timed(simulator.trial, poses)


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


def qhull_epsilon(wrenches: FloatArray) -> float:
    """Return epsilon from the whole hull, as scipy computes it: the peer."""
    try:
        return max(0.0, float(-ConvexHull(wrenches).equations[:, -1].max()))
    except QhullError:
        return 0.0


def print_peer(label: str, sets: Sequence[FloatArray], again: int) -> None:
    """Print the time of the own search beside Qhull's on the same wrench sets."""
    wrench_space.epsilon(sets[0])
    own_values, own = timed(wrench_space.epsilon, list(sets) * again)
    peer_values, peer = timed(qhull_epsilon, sets)
    apart = float(np.abs(np.array(own_values[: len(sets)]) - peer_values).max())
    low, middle, high = 1e3 * np.quantile(own.cpu, [0.05, 0.5, 0.95])
    ratio = peer.cpu.mean() / own.cpu.mean()
    print(
        f"{label} ({len(sets)} sets): CPU ms median {middle:.3f}, 5-95 % {low:.3f} to {high:.3f}, mean "
        f"{1e3 * own.cpu.mean():.3f} (wall {1e3 * own.wall.mean():.3f}); Qhull mean "
        f"{1e3 * peer.cpu.mean():.3f} (wall {1e3 * peer.wall.mean():.3f}); ratio of means {ratio:.1f}; "
        f"largest difference of epsilon {apart:.1e}"
    )


def wrenches_of(grasp: Grasp, target: TargetObject) -> FloatArray:
    """Return the wrench set of a grasp under the default settings."""
    settings = TrialSettings(cone_edges=EDGES)
    positions = np.array([contact.position for contact in grasp.contacts])
    normals = np.array([contact.normal for contact in grasp.contacts])
    return wrench_space.contact_wrenches(
        positions,
        normals,
        settings.friction,
        settings.cone_edges,
        target.center_of_mass,
        torque_length(target, settings),
    )


def drawn_wrenches(target: TargetObject, contacts: int, rng: np.random.Generator) -> FloatArray:
    """Return wrenches in force closure of contacts drawn over the object's surface."""
    areas = np.asarray(target.mesh.area_faces)
    length = torque_length(target, TrialSettings())
    while True:
        faces = rng.choice(len(areas), contacts, p=areas / areas.sum())
        points, inward = target.mesh.triangles_center[faces], -target.mesh.face_normals[faces]
        wrenches = wrench_space.contact_wrenches(
            points, inward, TrialSettings().friction, EDGES, target.center_of_mass, length
        )
        if wrench_space.force_closure(wrench_space.epsilon(wrenches)):
            return wrenches


def bench_epsilon(target: TargetObject, grasps: Sequence[Grasp], seed: int) -> None:
    """Print what epsilon costs, on the wrenches of the trials and on drawn contacts."""
    rng = np.random.default_rng(seed)
    print(f"epsilon, {EDGES} edges a contact, own search beside scipy's Qhull:")
    closed = [wrenches_of(grasp, target) for grasp in grasps if grasp.force_closure]
    rest = [wrenches_of(grasp, target) for grasp in grasps if grasp.contacts and not grasp.force_closure]
    for label, sets in (("trials in force closure", closed), ("other trials with contacts", rest)):
        if sets:
            print_peer(f"  {label}", sets[:MOST_HULLS], 3)
    for contacts in (6, 15):
        sets = [drawn_wrenches(target, contacts, rng) for _ in range(QHULL_REPETITIONS)]
        print_peer(f"  {contacts} contacts in force closure", sets, REPETITIONS // QHULL_REPETITIONS)
        _, spent = timed(wrench_space.epsilon, sets * (REPETITIONS // QHULL_REPETITIONS))
        asked = Target("mean CPU ms", 0.3 if contacts == 6 else 1.0, at_least=False)
        print(f"    {asked.verdict(1e3 * float(spent.cpu.mean()))}")


@dataclass(frozen=True)
class Target:
    """A figure that is asked of this machine's kind, one core.

    Args:
        name: what is measured.
        limit: the figure asked for.
        at_least: whether more is better.
    """

    name: str
    limit: float
    at_least: bool = True

    def verdict(self, value: float) -> str:
        """Return the figure beside what is asked, and whether it is reached."""
        if np.isnan(value):
            return f"{self.name}: not defined on these poses"
        reached = value >= self.limit if self.at_least else value <= self.limit
        sign = ">=" if self.at_least else "<="
        return f"{self.name}: {value:.4g} (asked {sign} {self.limit:g}; {'reached' if reached else 'MISSED'})"


def read_reference(folder: Path) -> tuple[list[dict[str, str]], list[Pose]]:
    """Return the rows of Simox's trials and their poses."""
    with (folder / "trials.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    values = np.array([[float(row[name]) for name in names] for row in rows])
    return rows, [Pose(value[:3], value[3:]) for value in values]


def bench_reference(folder: Path) -> None:
    """Print speed and agreement on the poses that Simox tried, where they are at hand."""
    if not (folder / "trials.csv").is_file():
        print("Simox's reference trials: skipped, ../shared/data/simox_bottle is not there")
        return
    target = TargetObject.from_file(folder / "bottle_collision.stl")
    rows, poses = read_reference(folder)
    print(f"{len(poses)} poses tried by Simox, friction {REFERENCE_FRICTION}, without volume:")
    hands = [(HAND, "bullet", 1000.0), (HAND, "fast", 5000.0)]
    if meshes_folder() is not None:
        hands.append((f"{HAND}_mesh", "bullet", 400.0))
    else:
        print("  the mesh hand: skipped, make icub-meshes was not run")
    for name, engine, asked in hands:
        settings = TrialSettings(
            friction=REFERENCE_FRICTION,
            cone_edges=EDGES,
            engine="fast" if engine == "fast" else "bullet",
            compute_volume=False,
        )
        grasps, timing = try_all(target, HandModel.load(name), settings, poses)
        print(f"  {name}, {engine}: {timing.line()}")
        print(f"         {Target('trials per CPU second', asked).verdict(len(poses) / timing.cpu.sum())}")
        print_agreement(grasps, rows)
        print_simox_figures(grasps, rows, target)


def print_simox_figures(grasps: Sequence[Grasp], rows: Sequence[dict[str, str]], target: TargetObject) -> None:
    """Print how far Simox's own figures, computed from these contacts, agree with Simox."""
    unit = simox.object_wrench_space(target, np.random.default_rng(FACES_SEED))
    own = np.zeros(len(grasps))
    for i, grasp in enumerate(grasps):
        if grasp.contacts:
            points = [contact.position for contact in grasp.contacts]
            own[i] = simox.simox_epsilon(
                simox.simox_wrenches(points, [contact.normal for contact in grasp.contacts], target), unit
            )
    theirs = np.array([float(row["simox_epsilon"]) for row in rows])
    free = np.array(
        [
            grasp.outcome is not GraspOutcome.COLLISION and row["collision"] == "0"
            for grasp, row in zip(grasps, rows, strict=True)
        ]
    )
    rank = float(spearmanr(own[free], theirs[free]).statistic)
    top = theirs[free] >= np.quantile(theirs[free], 0.9)
    apart = 100.0 * float(np.median(np.abs(own - theirs)[free][top] / theirs[free][top]))
    print(f"         {Target('Spearman of simox_epsilon', 0.90).verdict(rank)}")
    print(f"         {Target('top decile of simox_epsilon, median difference in %', 10.0, False).verdict(apart)}")


def bench_engines(trials: int, seed: int) -> None:
    """Print how far the two engines agree on three objects."""
    hand = HandModel.load(HAND)
    for name in ("bottle", "glass", "drill"):
        target = TargetObject.builtin(name)
        space, rng = pose_space_6d(target, hand), np.random.default_rng(seed)
        poses = [space.to_pose(x) for x in rng.uniform(space.lower, space.upper, (trials, space.dimension))]
        found = [
            try_all(target, hand, TrialSettings(engine=engine, compute_volume=False), poses)[0] for engine in ENGINES
        ]
        collides = np.array([[grasp.outcome is GraspOutcome.COLLISION for grasp in each] for each in found])
        free = ~collides.any(axis=0)
        epsilon = np.array([[grasp.epsilon for grasp in each] for each in found])[:, free]
        label = 100.0 * float(np.mean(collides[0] == collides[1]))
        rank = float(spearmanr(*epsilon).statistic)
        print(f"engines on the {name}, {trials} poses: {Target('collision label in %', 97.0).verdict(label)}")
        print(f"  {Target('Spearman of epsilon', 0.9).verdict(rank)}")


def bench_exactness(sets: int, seed: int) -> None:
    """Print the largest difference of epsilon from Qhull's over random contact sets of 1 to 15 contacts."""
    rng, worst, closed = np.random.default_rng(seed), 0.0, 0
    for _ in range(sets):
        contacts, edges = int(rng.integers(1, 16)), int(rng.integers(3, 11))
        normals = rng.normal(size=(contacts, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        wrenches = wrench_space.contact_wrenches(
            rng.uniform(-0.08, 0.08, (contacts, 3)), normals, float(rng.uniform(0.1, 1.2)), edges, np.zeros(3), 0.08
        )
        own, peer = wrench_space.epsilon(wrenches), qhull_epsilon(wrenches)
        worst, closed = max(worst, abs(own - peer)), closed + (peer > 1e-6)
    print(f"epsilon of {sets} random contact sets ({closed} in force closure), seed {seed}:")
    print(f"  {Target('largest difference from Qhull', 1e-9, False).verdict(worst)}")


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
    """Return the trials per second of some processes together, each with a simulator of its own."""
    context = multiprocessing.get_context("spawn")
    begin, pipes, workers = context.Event(), [], []
    for index in range(processes):
        ours, theirs = context.Pipe(duplex=False)
        workers.append(context.Process(target=_share_of_work, args=(trials, seed + index, begin, theirs)))
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
    rates = [rate_of_processes(1, trials, seed), rate_of_processes(2, trials, seed)]
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


def print_agreement(grasps: Sequence[Grasp], rows: Sequence[dict[str, str]]) -> None:
    """Print how far collision labels and the order by epsilon agree with Simox."""
    own = np.array([grasp.outcome is GraspOutcome.COLLISION for grasp in grasps])
    theirs = np.array([row["collision"] == "1" for row in rows])
    free = ~own & ~theirs
    epsilon = np.array([grasp.epsilon for grasp in grasps])[free]
    print(
        f"         collision label agrees on {100 * np.mean(own == theirs):.1f} % "
        f"(colliding here {100 * own.mean():.1f} %, there {100 * theirs.mean():.1f} %)"
    )
    for column in ("simox_epsilon", "gws_ball_radius_about_origin"):
        reference = np.array([float(row[column] or 0.0) for row in rows])[free]
        rank = float(spearmanr(epsilon, reference).statistic)
        print(
            f"         Spearman of epsilon against {column} over {free.sum()} poses free in both: {rank:.3f}"
        )


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
    print(
        f"load average {os.getloadavg()[0]:.1f}; {HAND} on the bottle, {options.trials} poses, seed {options.seed}"
    )
    grasps = bench_trials(target, hand, options.trials, options.seed)
    bench_epsilon(target, grasps, options.seed)
    bench_exactness(options.sets, options.seed)
    bench_reference(REFERENCE_TRIALS)
    bench_engines(options.trials, options.seed)
    bench_processes(options.trials, options.seed)
    bench_start()
    print(f"load average at the end {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
