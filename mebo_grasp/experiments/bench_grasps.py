"""Prints which grasps the methods find: ``python -m mebo_grasp.experiments.bench_grasps``.

Each method explores each object in the hand simulator, in position space with 250 trials (25 initial) and in
pose space with 500 (50 initial), the thesis's protocol (section 7.4). Printed are the best quality and the mean
quality of the four best grasps that are 40 mm apart (a radian counting as 50 mm), mean and standard deviation
over the seeds. The set is chosen from all trials in the same way for every method. All methods are told how many
solutions are wanted and, in position space, how far apart, as the command line tells them. With ``--out`` every
run is also appended to a file as a line of JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import PoseSpace, pose_space_6d, position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, TargetObject
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set

BENCH_METHODS = (DEFAULT_METHOD, "mebo", "cl_mebo", "robot", "random")
SET_SIZE, SET_DISTANCE, ROTATION_WEIGHT = 4, 0.04, 0.05
"""Grasps of the set, their least distance in metres, and the metres that a radian counts."""


@dataclass(frozen=True)
class Run:
    """What one exploration found.

    Args:
        object: name of the object.
        space: "position" or "pose".
        method: name of the method.
        seed: of the run.
        best: highest quality.
        set_quality: mean quality of the diverse set.
        off_plateau: share of the trials with a quality above 0.
        cpu_seconds: of the optimizer alone.
    """

    object: str
    space: str
    method: str
    seed: int
    best: float
    set_quality: float
    off_plateau: float
    cpu_seconds: float


def explore(target: TargetObject, hand: HandModel, space: str, method: str, seed: int) -> Run:
    """Explore once."""
    poses = (position_space if space == "position" else pose_space_6d)(target, hand)
    budget, initial = (250, 25) if space == "position" else (500, 50)
    distance = SET_DISTANCE if space == "position" else None
    settings = OptimizerSettings(
        budget=budget, n_initial=initial, num_solutions=SET_SIZE, min_distance=distance
    )
    optimizer = Optimizer(SearchSpace(poses.names, poses.lower, poses.upper), method, settings, seed)
    cpu = 0.0
    with GraspSimulator(target, hand) as simulator:
        while not optimizer.finished:
            begin = time.process_time()
            trials = optimizer.ask()
            cpu += time.process_time() - begin
            for trial in trials:
                optimizer.tell(trial.id, simulator.trial(poses.to_pose(trial.x)).quality)
    y = optimizer.observations.y
    X = optimizer.space.from_unit(optimizer.observations.U)
    kept = greedy_diverse_set(_in_metres(X, poses), y, SET_SIZE, SET_DISTANCE)
    return Run(
        target.object_id, space, method, seed, float(np.max(y)), float(np.mean(y[kept])),
        float(np.mean(y > 0.0)), cpu,
    )


def _in_metres(X: FloatArray, poses: PoseSpace) -> FloatArray:
    weights = np.array([1.0 if unit == "m" else ROTATION_WEIGHT for unit in poses.units])
    return X * weights


def report(runs: Sequence[Run]) -> str:
    """One line for the runs of one cell of the table."""
    best, kept = np.array([run.best for run in runs]), np.array([run.set_quality for run in runs])
    return (
        f"{runs[0].object:10s} {runs[0].space:9s} {runs[0].method:20s} {len(runs):2d} seeds  "
        f"best {best.mean():.4f} ± {best.std():.4f}   set of {SET_SIZE} {kept.mean():.4f} ± {kept.std():.4f}   "
        f"off the plateau {np.mean([run.off_plateau for run in runs]):.2f}   "
        f"optimizer {np.mean([run.cpu_seconds for run in runs]):.1f} CPU s"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print a line for each object, space and method."""
    parser = argparse.ArgumentParser(description="Grasp quality found by the methods")
    parser.add_argument("--objects", nargs="+", choices=BUILTIN_OBJECTS, default=["bottle", "vase", "drill"])
    parser.add_argument("--spaces", nargs="+", choices=("position", "pose"), default=["position", "pose"])
    parser.add_argument("--methods", nargs="+", choices=METHOD_NAMES, default=list(BENCH_METHODS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--hand", default="icub_left")
    parser.add_argument("--out", type=Path, help="file to append the runs to, a JSON line each")
    options = parser.parse_args(arguments)
    hand = HandModel.load(options.hand)
    for name in options.objects:
        target = TargetObject.builtin(name)
        for space in options.spaces:
            for method in options.methods:
                seeds = range(options.first_seed, options.first_seed + options.seeds)
                runs = [explore(target, hand, space, method, seed) for seed in seeds]
                sys.stdout.write(f"{report(runs)}\n")
                sys.stdout.flush()
                if options.out:
                    with options.out.open("a", encoding="utf-8") as stream:
                        stream.writelines(f"{json.dumps(asdict(run))}\n" for run in runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
