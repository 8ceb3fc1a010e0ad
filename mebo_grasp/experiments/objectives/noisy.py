"""What the UBO paper optimizes: functions and grasps of which a recommended point is carried out with input noise.

The noise is isotropic in the unit cube. A point is judged by Monte Carlo (paper, section V): a coordinate that would
leave the box keeps its value without noise (the paper's code). All points and methods of a seed meet the same noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.objective import (
    BatchFunction,
    Evaluator,
    NoisyOutcome,
    Objective,
    checked_choice,
    pointwise,
    settings_digest,
)
from mebo_grasp.experiments.objectives.grasp import load_target, name_of
from mebo_grasp.experiments.problems import NOISY_INPUT_FUNCTIONS, get_noisy_input_problem
from mebo_grasp.grasp import FloatArray
from mebo_grasp.grasping.facet_space import FACETS, facet_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.robustness import perturb_point
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.trial import ENGINE_NAMES, QUALITY_NAMES, EngineName, QualityName, TrialSettings
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.methods.registry import WITHOUT_CHOICE
from mebo_grasp.optimization.search_space import SearchSpace

FACET_SPACES = {"position": 3, "pose": 6, "synergy": 7}
"""Increments that are searched: of the position, of the pose, and the amplitude of the first synergy too."""
_FUNCTION_EXECUTIONS = 100
_MARGIN = 0.01
_GRASP_MIN_LEAF = 20
_FUNCTION_NOISE, _GRASP_NOISE = 1e-6, 1e-4


def noisy_judge(
    function: BatchFunction, space: SearchSpace, sd: float, executions: int, seed: int
) -> Callable[[FloatArray], NoisyOutcome]:
    """Return what carries out a point, shape (d,), with noise.

    Args:
        function: values, shape (n,), of points, shape (n, d), real units.
        space: the box.
        sd: standard deviation of the inputs, sides of the box.
        executions: how many.
        seed: of the run.
    """

    def judge(x: FloatArray) -> NoisyOutcome:
        rng = np.random.default_rng([seed, 1])
        carried_out = [perturb_point(x, space.lower, space.upper, sd, rng) for _ in range(executions)]
        values = function(np.array(carried_out))
        return NoisyOutcome(float(np.mean(values)), float(np.std(values, ddof=1)), float(np.min(values)))

    return judge


def _told(method: str, sd: float, min_leaf: int, noise_variance: float) -> dict[str, Any]:
    """The paper's protocol: hyperparameters are learned anew at each trial, but for the noise of the values.

    The margin is that of the paper's code for functions.
    """
    told = {
        "input_noise": InputNoise((sd,)), "relearn_period": 1, "improvement_margin": _MARGIN, "min_leaf": min_leaf,
    }  # fmt: skip
    return told if method in WITHOUT_CHOICE else {**told, "noise_variance": noise_variance}


@dataclass(frozen=True)
class NoisyFunction(Objective):
    """A function of the paper (section V-A), under the paper's noise.

    Args:
        problem: its name.
    """

    problem: str

    @property
    def label(self) -> str:
        """The function's name."""
        return self.problem

    @property
    def group(self) -> str:
        """All functions stand in one table."""
        return "functions"

    def check(self) -> None:
        """Refuse an unknown function.

        Raises:
            InvalidSettingsError: naming those that are known.
        """
        checked_choice("problem", self.problem, NOISY_INPUT_FUNCTIONS)

    @contextmanager
    def open(self, seed: int) -> Iterator[Evaluator]:
        """Make the function."""
        noisy = get_noisy_input_problem(self.problem)
        problem = noisy.problem
        space = SearchSpace.unit_cube(problem.dim)
        judge = noisy_judge(problem, space, noisy.noise_sd, _FUNCTION_EXECUTIONS, seed)
        yield Evaluator(space, problem, judge)

    def told(self, method: str, seed: int) -> dict[str, Any]:
        """Noise of the inputs and of the values, and leaf size."""
        del seed
        noisy = get_noisy_input_problem(self.problem)
        return _told(method, noisy.noise_sd, noisy.min_leaf, _FUNCTION_NOISE)


@dataclass(frozen=True)
class NoisyGrasp(Objective):
    """Quality of a grasp by increments of the hand's pose before a facet of the object's box (section V-B).

    Args:
        object: a built-in object, a mesh file, or ``package:file`` for a file of an installed package.
        facet: the facet that the palm faces.
        space: which increments, of ``FACET_SPACES``; the others are 0, or the hand's preshape.
        quality: the metric that is maximized; the paper's is Simox's epsilon.
        input_sd: standard deviation of the inputs, sides of the box.
        executions: by which a recommended grasp is judged.
        scale: factor from the mesh's unit to metres.
        hand: name of a built-in hand.
        engine: "bullet" or "fast".
    """

    object: str
    facet: str = "+y"
    space: str = "position"
    quality: QualityName = "simox_epsilon"
    input_sd: float = 0.03
    executions: int = 20
    scale: float = 1.0
    hand: str = "icub_left"
    engine: EngineName = "bullet"

    @property
    def object_name(self) -> str:
        """The object's name in folders and tables."""
        return name_of(self.object)

    @property
    def label(self) -> str:
        """Object, facet, space and quality, with eight digits where another setting has not its default."""
        shown = {"facet", "space", "quality"} | ({"object"} if self.object == self.object_name else set())
        rest = settings_digest(self, frozenset(shown))
        return f"{self.object_name}/facet-{self.facet.replace('+', '')}-{self.space}/{self.quality}{rest}"

    @property
    def column(self) -> str:
        """Object and facet."""
        return f"{self.object_name} {self.facet}"

    @property
    def group(self) -> str:
        """Metric and space."""
        return f"{self.quality}, facet {self.space}"

    def check(self) -> None:
        """Refuse settings out of range, without loading the object.

        Raises:
            InvalidSettingsError: naming the setting, its value and those allowed.
        """
        checked_choice("facet", self.facet, FACETS)
        checked_choice("space", self.space, tuple(FACET_SPACES))
        checked_choice("quality", self.quality, QUALITY_NAMES)
        checked_choice("engine", self.engine, ENGINE_NAMES)
        if not 0.0 <= self.input_sd < np.inf or self.executions < 2:
            raise InvalidSettingsError(
                f"input_sd must be finite and at least 0 and executions at least 2, got {self.input_sd} and "
                f"{self.executions}"
            )

    @contextmanager
    def open(self, seed: int) -> Iterator[Evaluator]:
        """Load the object and its hand; those of the last objective are kept."""
        self.check()
        space, evaluate = _grasps(self)
        function = pointwise(evaluate)
        yield Evaluator(space, function, noisy_judge(function, space, self.input_sd, self.executions, seed))

    def told(self, method: str, seed: int) -> dict[str, Any]:
        """Noise of the inputs and of the values, and leaf size."""
        del seed
        return _told(method, self.input_sd, _GRASP_MIN_LEAF, _GRASP_NOISE)


@lru_cache(maxsize=8)
def _grasps(objective: NoisyGrasp) -> tuple[SearchSpace, Callable[[FloatArray], float]]:
    # A simulator takes seconds to build, and a worker comes back to the same few objectives at every seed.
    target, hand = load_target(objective.object, objective.scale), HandModel.load(objective.hand)
    whole = facet_space(target, hand, facet=objective.facet, synergy=objective.space == "synergy")
    dim = FACET_SPACES[objective.space]
    rest = np.zeros(whole.dimension - dim)
    settings = TrialSettings(quality=objective.quality, engine=objective.engine, compute_volume=False)
    simulator = GraspSimulator(target, hand, settings)

    def evaluate(x: FloatArray) -> float:
        candidate = np.concatenate([x, rest])
        return simulator.trial(whole.to_pose(candidate), whole.to_posture(candidate)).quality

    return SearchSpace(whole.names[:dim], whole.lower[:dim], whole.upper[:dim], whole.units[:dim]), evaluate
