"""Prints what a trial of the simulated hand costs: ``python -m mebo_grasp.experiments.bench_hand``.

Poses are drawn uniformly from the bottle's position space; ROS has no part in it. Wall time is what a user waits
for, CPU time is what counts on a shared machine. Beside the own search for epsilon stands scipy's Qhull on the
same wrench sets. Where the reference trials of Simox are at hand, their poses are tried too.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import spearmanr

from mebo_grasp.grasp import FloatArray, Grasp, GraspOutcome, Pose
from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
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


def bench_reference(hand: HandModel, folder: Path) -> None:
    """Print speed and agreement on the poses that Simox tried, where they are at hand."""
    if not (folder / "trials.csv").is_file():
        print("Simox's reference trials: skipped, ../shared/data/simox_bottle is not there")
        return
    target = TargetObject.from_file(folder / "bottle_collision.stl")
    with (folder / "trials.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    values = np.array([[float(row[name]) for name in names] for row in rows])
    poses = [Pose(value[:3], value[3:]) for value in values]
    print(f"{len(poses)} poses tried by Simox, friction {REFERENCE_FRICTION}, without volume:")
    for engine in ENGINES:
        settings = TrialSettings(
            friction=REFERENCE_FRICTION, cone_edges=EDGES, engine=engine, compute_volume=False
        )
        grasps, timing = try_all(target, hand, settings, poses)
        print(f"  {engine:6s} {timing.line()}")
        print_agreement(grasps, rows)


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
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    if options.trials < 1 or options.seed < 0:
        parser.error("--trials must be at least 1 and --seed at least 0")
    target, hand = TargetObject.builtin("bottle"), HandModel.load(HAND)
    print(
        f"load average {os.getloadavg()[0]:.1f}; {HAND} on the bottle, {options.trials} poses, seed {options.seed}"
    )
    grasps = bench_trials(target, hand, options.trials, options.seed)
    bench_epsilon(target, grasps, options.seed)
    bench_reference(hand, REFERENCE_TRIALS)
    print(f"load average at the end {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
