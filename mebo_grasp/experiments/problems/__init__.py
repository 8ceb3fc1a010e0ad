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
from mebo_grasp.experiments.problems.problem import Problem
from mebo_grasp.experiments.problems.transformed import transform

__all__ = [
    "ALL_FUNCTIONS",
    "AS_WRITTEN",
    "BATCH_VARIANCE_FUNCTIONS",
    "CLASSIC_FUNCTIONS",
    "THESIS_FUNCTIONS",
    "Problem",
    "get_classic",
    "get_problem",
    "select_problems",
    "transform",
]
