"""Prints which grasps the methods find: ``python -m mebo_grasp.benchmarks.grasps``.

Each method explores each object in the hand simulator, in position space with 250 trials (25 initial) and in
pose space with 500 (50 initial), the thesis's protocol (section 7.4). All methods are told how many solutions are
wanted and how far apart, as the command line tells them. Printed are, as mean and standard deviation over the seeds:

- the best quality;
- mean quality and size of the diverse set: the best grasps 40 mm apart, a radian counting as 50 mm. It is chosen from
  all trials in the same way for every method.
- retention: the best quality left when every grasp within 20 and 40 mm of the best is dropped, as a share of the best.

``--objects simox_bottle`` is the thesis's bottle in the thesis's boxes with Simox's figure as the quality, where
the reference data lie beside the repository; there the best with its small and large occlusion is printed as well.
With ``--out`` every run is appended to a file as a line of JSON, and runs that the file already holds are not repeated.
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
from mebo_grasp.grasping.candidate_space import CandidateSpace, candidate_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import distance_weights
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, TargetObject
from mebo_grasp.grasping.trial import TrialSettings
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set

BENCH_METHODS = (DEFAULT_METHOD, "mebo", "cl_mebo", "robot", "random")
SPACES = ("position", "pose")
SET_SIZE, SET_DISTANCE, ROTATION_WEIGHT = 4, 0.04, 0.05
"""Grasps of the set, their least distance in metres, and the metres that a radian counts."""
RETENTION_RADII = (0.02, 0.04)
SIMOX_BOTTLE = "simox_bottle"
SIMOX_MESH = Path(__file__).parents[3] / "shared" / "data" / SIMOX_BOTTLE / "bottle_collision.stl"
SIMOX_BOXES = {
    "position": ((-0.076, 0.026, -0.21), (-0.023, 0.081, -0.026)),
    "pose": ((-0.061, 0.016, -0.21, -1.8, -0.4, -0.78), (-0.011, 0.071, 0.005, -0.78, 0.4, 0.78)),
}
"""The thesis's search boxes in the frame of the bottle's mesh, metres and radians."""
SIMOX_OCCLUDED = (-0.15, -0.03)
"""Heights of the TCP between which grasps are blocked; the large occlusion has no upper end (thesis 7.4.3)."""


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
        set_size: number of grasps of the set with a quality above 0.
        retention: best quality outside each of ``RETENTION_RADII`` around the best grasp, over the best.
        occluded: best quality with the small and with the large occlusion; empty without these.
        off_plateau: share of the trials with a quality above 0.
        cpu_seconds: of the optimizer alone.
    """

    object: str
    space: str
    method: str
    seed: int
    best: float
    set_quality: float
    set_size: int
    retention: list[float]
    occluded: list[float]
    off_plateau: float
    cpu_seconds: float


@dataclass(frozen=True, eq=False)
class Scene:
    """An object, the hand, and where it searches.

    Args:
        target: the object.
        hand: the hand.
        poses: the space of candidates.
        settings: of the trials.
        occluded: heights of the TCP that the small occlusion blocks, metres; None for no occlusion.
    """

    target: TargetObject
    hand: HandModel
    poses: CandidateSpace
    settings: TrialSettings
    occluded: tuple[float, float] | None = None

    @classmethod
    def of(cls, name: str, space: str, hand: HandModel) -> Scene:
        """Set the scene of an object, a built-in one or ``SIMOX_BOTTLE``, in a space.

        Raises:
            MeboGraspError: the object cannot be loaded.
        """
        if name != SIMOX_BOTTLE:
            target = TargetObject.builtin(name)
            return cls(target, hand, candidate_space(space, target, hand), TrialSettings(compute_volume=False))
        target = TargetObject.from_file(SIMOX_MESH)
        settings = TrialSettings(quality="simox_epsilon", compute_volume=False)
        return cls(target, hand, candidate_space(space, target, hand, *SIMOX_BOXES[space]), settings, SIMOX_OCCLUDED)

    @property
    def search_space(self) -> SearchSpace:
        """The box in which the optimizer searches."""
        poses = self.poses
        weights = distance_weights(poses.units, ROTATION_WEIGHT)
        return SearchSpace(poses.names, poses.lower, poses.upper, poses.units, weights)


def explore(scene: Scene, method: str, seed: int) -> tuple[Optimizer, float]:
    """Explore once; the optimizer when its budget is spent, and the CPU seconds that it took."""
    budget, initial = (250, 25) if scene.poses.dimension == 3 else (500, 50)
    settings = OptimizerSettings(budget=budget, n_initial=initial, num_solutions=SET_SIZE, min_distance=SET_DISTANCE)
    optimizer = Optimizer(scene.search_space, method, settings, seed)
    cpu = 0.0
    with GraspSimulator(scene.target, scene.hand, scene.settings) as simulator:
        while not optimizer.finished:
            begin = time.process_time()
            trials = optimizer.ask()
            cpu += time.process_time() - begin
            for trial in trials:
                optimizer.tell(trial.id, simulator.trial(scene.poses.to_pose(trial.x)).quality)
    return optimizer, cpu


def run_of(scene: Scene, name: str, space: str, method: str, seed: int) -> Run:
    """Explore once and measure what was found."""
    optimizer, cpu = explore(scene, method, seed)
    X, y = optimizer.space.from_unit(optimizer.observations.U), optimizer.observations.y
    weighted = X * optimizer.space.distance_weights
    kept = greedy_diverse_set(weighted, y, SET_SIZE, SET_DISTANCE)
    return Run(
        name,
        space,
        method,
        seed,
        float(np.max(y)),
        float(np.mean(y[kept])),
        int(np.count_nonzero(y[kept] > 0.0)),
        retention(weighted, y),
        occluded(X, y, scene),
        float(np.mean(y > 0.0)),
        cpu,
    )


def retention(X: FloatArray, y: FloatArray) -> list[float]:
    """Best value at each of ``RETENTION_RADII`` or more from the best point, over the best.

    Args:
        X: points, shape (n, d), metres.
        y: values, shape (n,).
    """
    best = int(np.argmax(y))
    if y[best] <= 0.0:
        return [0.0] * len(RETENTION_RADII)
    distances = np.linalg.norm(X - X[best], axis=1)
    left = [float(np.max(y[distances >= radius], initial=0.0)) for radius in RETENTION_RADII]
    return [value / float(y[best]) for value in left]


def occluded(X: FloatArray, y: FloatArray, scene: Scene) -> list[float]:
    """Best value, of y, shape (n,), that the small and the large occlusion leave of grasps X, shape (n, d)."""
    if scene.occluded is None:
        return []
    height, (low, high) = X[:, scene.poses.names.index("z")], scene.occluded
    below = height < low
    return [float(np.max(y[free], initial=0.0)) for free in (below | (height > high), below)]


def report(runs: Sequence[Run]) -> str:
    """One line for the runs of one cell of the table."""

    def spread(values: Sequence[float]) -> str:
        return f"{np.mean(values):.4f} ± {np.std(values):.4f}"

    kept = np.transpose([run.retention for run in runs])
    blocked = np.transpose([run.occluded for run in runs])
    return (
        f"{runs[0].object:12s} {runs[0].space:9s} {runs[0].method:13s} {len(runs):2d} seeds  "
        f"best {spread([run.best for run in runs])}   set {spread([run.set_quality for run in runs])} "
        f"of {np.mean([run.set_size for run in runs]):.1f}   "
        f"retention {', '.join(spread(values) for values in kept)}   "
        + "".join(f"occluded {', '.join(spread(values) for values in blocked)}   " if len(blocked) else "")
        + f"off the plateau {np.mean([run.off_plateau for run in runs]):.2f}   "
        f"optimizer {np.mean([run.cpu_seconds for run in runs]):.1f} CPU s"
    )


def known_runs(path: Path | None) -> dict[tuple[str, str, str, int], Run]:
    """Runs that a file of ``--out`` holds."""
    if path is None or not path.exists():
        return {}
    runs = [Run(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]
    return {(run.object, run.space, run.method, run.seed): run for run in runs}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print a line for each object, space and method."""
    objects = (*BUILTIN_OBJECTS, *((SIMOX_BOTTLE,) if SIMOX_MESH.is_file() else ()))
    parser = argparse.ArgumentParser(description="Grasp quality found by the methods")
    parser.add_argument("--objects", nargs="+", choices=objects, default=["bottle", "vase", "drill"])
    parser.add_argument("--spaces", nargs="+", choices=SPACES, default=list(SPACES))
    parser.add_argument("--methods", nargs="+", choices=METHOD_NAMES, default=list(BENCH_METHODS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--hand", default="icub_left")
    parser.add_argument("--out", type=Path, help="file of the runs, a JSON line each; runs in it are not repeated")
    options = parser.parse_args(arguments)
    if options.seeds < 1 or options.first_seed < 0:
        parser.error(
            f"--seeds must be at least 1 and --first-seed at least 0, got {options.seeds} and {options.first_seed}"
        )
    hand = HandModel.load(options.hand)
    known = known_runs(options.out)
    for name in options.objects:
        for space in options.spaces:
            scene = Scene.of(name, space, hand)
            for method in options.methods:
                runs = []
                for seed in range(options.first_seed, options.first_seed + options.seeds):
                    run = known.get((name, space, method, seed))
                    if run is None:
                        run = run_of(scene, name, space, method, seed)
                        if options.out:
                            with options.out.open("a", encoding="utf-8") as stream:
                                stream.write(f"{json.dumps(asdict(run))}\n")
                    runs.append(run)
                sys.stdout.write(f"{report(runs)}\n")
                sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
