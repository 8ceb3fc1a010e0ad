"""Benchmark problems with known optima: the CEC 2013 niching suite, its random transforms, classics."""

from mebo_grasp.experiments.problems.cec2013 import (
    ALL_FUNCTIONS,
    THESIS_FUNCTIONS,
    get_problem,
    select_problems,
)
from mebo_grasp.experiments.problems.classic import (
    AS_WRITTEN,
    BATCH_VARIANCE_FUNCTIONS,
    CLASSIC_FUNCTIONS,
    get_classic,
)
from mebo_grasp.experiments.problems.input_noise import (
    NOISY_INPUT_FUNCTIONS,
    NoisyInputProblem,
    get_noisy_input_problem,
)
from mebo_grasp.experiments.problems.problem import Problem
from mebo_grasp.experiments.problems.transformed import transform

__all__ = [
    "ALL_FUNCTIONS",
    "AS_WRITTEN",
    "BATCH_VARIANCE_FUNCTIONS",
    "CLASSIC_FUNCTIONS",
    "NOISY_INPUT_FUNCTIONS",
    "THESIS_FUNCTIONS",
    "NoisyInputProblem",
    "Problem",
    "get_classic",
    "get_noisy_input_problem",
    "get_problem",
    "select_problems",
    "transform",
]
