"""Compiles what is compiled at its first use, so that the first exploration does not wait for it.

The compiled code is cached beside the modules, or in the user's cache where those cannot be written.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from mebo_grasp.grasp import Grasp, GraspOutcome, StampedGrasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d, position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import EngineName, TrialSettings
from mebo_grasp.hand_volumes import HandVolumes
from mebo_grasp.optimization.methods.registry import METHOD_NAMES
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Shape, Sphere, TriangleMesh

TRIALS = 30
ENOUGH_FOR_A_TREE = 600
"""Fewer grasps are looked at one by one, so that the search tree would not be compiled."""
SHAPES: tuple[Shape, ...] = (
    Box((0.1, 0.1, 0.1)), Sphere(0.05), Cylinder(0.1, 0.02), Cone(0.1, 0.02),
    TriangleMesh(0.05 * np.eye(3), np.array([[0, 1, 2]])),
)  # fmt: skip


def run_trials() -> list[Grasp]:
    """Try poses across the bottle."""
    target, hand = TargetObject.builtin("bottle"), HandModel.load("icub_left")
    space, rng = position_space(target, hand), np.random.default_rng(1)
    poses = [space.to_pose(rng.uniform(space.lower, space.upper)) for _ in range(TRIALS)]
    grasps = []
    engines: tuple[EngineName, ...] = ("fast", "bullet")
    for engine in engines:
        with GraspSimulator(target, hand, TrialSettings(engine=engine)) as simulator:
            grasps += [simulator.trial(pose) for pose in poses]
    return grasps


def run_optimizers() -> None:
    """Let every method choose some batches."""
    target, hand = TargetObject.builtin("bottle"), HandModel.load("icub_left")
    poses = pose_space_6d(target, hand)
    space = SearchSpace(poses.names, poses.lower, poses.upper)
    for method in METHOD_NAMES:
        settings = OptimizerSettings(budget=TRIALS, n_initial=12, num_solutions=2, min_distance=0.1)
        optimizer = Optimizer(space, method, settings, np.random.default_rng(1))
        while not optimizer.finished:
            for trial in optimizer.ask():
                optimizer.tell(trial.id, float(np.cos(20.0 * trial.x).sum()))
        optimizer.solution_set(2, 0.1)


def run_archive(grasps: list[Grasp]) -> None:
    """Store trials and ask for the best with every shape in the way, by either rule and distance."""
    occlusions = tuple(Occlusion(f"shape {i}", shape, grasps[0].T_object_tcp) for i, shape in enumerate(SHAPES))
    good = replace(grasps[0], outcome=GraspOutcome.GRASPED, quality=0.5)
    hand = HandModel.load("icub_left")
    volumes = HandVolumes([hand])
    for metric in (PoseMetric(), PoseMetric(symmetry_axis=(0.0, 0.0, 1.0))):
        with SolutionArchive(
            ":memory:", "bottle", metric, hand_volume=volumes, approach_axis=hand.approach_axis
        ) as archive:
            archive.add_many(StampedGrasp(stamp, good) for stamp in range(ENOUGH_FOR_A_TREE))
            for stamp, grasp in enumerate(grasps, start=ENOUGH_FOR_A_TREE):
                archive.add(StampedGrasp(stamp, grasp))
            for rule in BlockingRule:
                archive.best(
                    BestGraspQuery(occlusions, max_grasps=5, min_diversity=0.02, rule=rule, approach_length=0.1)
                )
            archive.solution_set(4, 0.04)


def main() -> None:
    """Use everything once."""
    begin = time.perf_counter()
    run_archive(run_trials())
    run_optimizers()
    print(f"compiled in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
