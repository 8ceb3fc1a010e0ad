"""What the studies of input noise optimize: functions and grasps, with the noise under which a point is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import NOISY_INPUT_FUNCTIONS, get_noisy_input_problem
from mebo_grasp.grasp import FloatArray
from mebo_grasp.grasping.facet_space import facet_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.robustness import perturb_point
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings
from mebo_grasp.optimization.search_space import SearchSpace

GRASP_NOISE_SD = 0.03
"""Input noise of grasps, sides of the cube (UBO paper, section V-B)."""

SCENES = {
    "bottle_side": ("bottle", "+y"),
    "bottle_top": ("bottle", "+z"),
    "mug": ("mug", "+y"),
    "glass": ("glass", "+y"),
    "drill": ("drill", "+y"),
}
"""Objects of the paper, each with the facet that the hand faces."""

TARGET_NAMES = (*NOISY_INPUT_FUNCTIONS, *SCENES)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a point that was carried out with noise.

    Args:
        mean, sd, worst: of the values; sd with n - 1 in the divisor.
    """

    mean: float
    sd: float
    worst: float


@dataclass(frozen=True, eq=False)
class NoisyTarget:
    """Something to maximize, and how a point of it is judged.

    Args:
        name: of ``TARGET_NAMES``.
        space: the search space.
        evaluate: value of a point, shape (d,), real units.
        noise_sd: standard deviation of the inputs, sides of the cube.
        samples: executions by which a point is judged (paper: 100; 20 for grasps).
        n_initial: points of the initial design.
        n_iterations: trials after it.
        min_leaf: observations of a leaf of the treed surrogate, at least.
    """

    name: str
    space: SearchSpace
    evaluate: Callable[[FloatArray], float]
    noise_sd: float
    samples: int
    n_initial: int
    n_iterations: int
    min_leaf: int

    def outcome(self, x: FloatArray, rng: np.random.Generator) -> Outcome:
        """Execute a point, shape (d,), with noise; a coordinate that would leave the box stays as it is."""
        values = [
            self.evaluate(perturb_point(x, self.space.lower, self.space.upper, self.noise_sd, rng))
            for _ in range(self.samples)
        ]
        return Outcome(float(np.mean(values)), float(np.std(values, ddof=1)), float(np.min(values)))


def get_target(name: str, treed: bool = False) -> NoisyTarget:
    """Build one of ``TARGET_NAMES`` in the sizes of the study of input noise, or of that of the treed surrogate.

    Raises:
        InvalidSettingsError: there is no such target.
    """
    if name in NOISY_INPUT_FUNCTIONS:
        return _function(name, treed)
    if name in SCENES:
        return _grasp(name, treed)
    raise InvalidSettingsError(f"target must be one of {', '.join(TARGET_NAMES)}, got {name!r}")


def _function(name: str, treed: bool) -> NoisyTarget:
    noisy = get_noisy_input_problem(name)
    problem = noisy.problem

    def evaluate(x: FloatArray) -> float:
        return float(problem(x[None])[0])

    trials = noisy.n_tgp if treed else noisy.n_ubo
    space = SearchSpace.unit_cube(problem.dim)
    return NoisyTarget(name, space, evaluate, noisy.noise_sd, 100, noisy.n_initial, trials, noisy.min_leaf)


def _grasp(name: str, treed: bool) -> NoisyTarget:
    """Translations only for input noise; for the treed surrogate angles and the first synergy too (paper, V-B)."""
    object_name, facet = SCENES[name]
    target, hand = TargetObject.load(object_name), HandModel.load("icub_left")
    scene = facet_space(target, hand, facet=facet, synergy=treed)
    simulator = GraspSimulator(target, hand, TrialSettings())
    dim = len(scene.names) if treed else 3
    rest = np.zeros(len(scene.names) - dim)

    def evaluate(x: FloatArray) -> float:
        whole = np.concatenate([x, rest])
        return simulator.trial(scene.to_pose(whole), scene.to_posture(whole)).quality

    space = SearchSpace(scene.names[:dim], scene.lower[:dim], scene.upper[:dim], scene.units[:dim])
    sizes = (30, 120) if treed else (40, 60)
    return NoisyTarget(name, space, evaluate, GRASP_NOISE_SD, 20, *sizes, 20)
