"""How far trials agree with Simox's reference trials, and the two engines with each other."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from mebo_grasp.benchmarks.figures import EDGES, ENGINES, HAND, Target, try_all
from mebo_grasp.benchmarks.hand_gaps import print_true_gaps
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.icub_meshes import meshes_folder
from mebo_grasp.grasping.metrics import simox
from mebo_grasp.grasping.metrics.chosen import FACES_SEED
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

REFERENCE_TRIALS = Path(__file__).parents[3] / "shared" / "data" / "simox_bottle"
REFERENCE_FRICTION = 1.0
"""The effective coefficient behind the Simox figures: its cone edges stand at 45 degrees."""


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
        print_true_gaps(grasps, target, HandModel.load(name), settings.gap_tolerance)


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
        print(f"         Spearman of epsilon against {column} over {free.sum()} poses free in both: {rank:.3f}")


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
        closed = int((epsilon > 0.0).any(axis=0).sum())
        print(f"  {Target('Spearman of epsilon', 0.9).verdict(rank)}, above 0 at {closed} of {free.sum()} free poses")
        # A mesh says nothing of Bullet's distances to several convex parts, of which built-in objects consist.
        for engine, grasps in zip(ENGINES, found, strict=True):
            print(f"  {engine}:")
            print_true_gaps(grasps, target, hand, TrialSettings().gap_tolerance)
