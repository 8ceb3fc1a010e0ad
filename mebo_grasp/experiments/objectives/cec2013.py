"""The niching functions of CEC 2013, plain or moved at random, as an objective; scored by the optima found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from mebo_grasp.experiments.objective import Evaluator, Objective, Trace, WantedSet, checked_choice
from mebo_grasp.experiments.problems import (
    ALL_FUNCTIONS,
    CLASSIC_FUNCTIONS,
    Problem,
    get_classic,
    get_problem,
    transform,
)
from mebo_grasp.experiments.problems.metrics import (
    STRICT_ACCURACIES,
    competition_count,
    mean_batch_variance,
    strict_count,
    text_count,
    thesis_score,
)
from mebo_grasp.experiments.published.thesis import TITLES
from mebo_grasp.optimization.search_space import SearchSpace

TOLD_METHODS = frozenset({"cl_mebo", "robot"})
"""Methods that are given M and tau, as in the thesis (section 7.3); no other is told anything."""
_THESIS_M = {"vincent_2d": 20, "uneven_maxima": 2}
_THESIS_TAU = {
    "uneven_maxima": 0.15,
    "five_uneven_peak_trap": 15.0,
    "equal_maxima": 0.15,
    "himmelblau": 2.0,
    "modified_rastrigin": 0.25,
    "vincent_2d": 2.0,
}
_OTHER_TAU_SHARE = 0.5


@dataclass(frozen=True)
class Cec2013(Objective):
    """A function of the suite, or one of table D.1.

    Args:
        problem: its name.
        transformed: whether it is shifted, scaled and turned by the seed's draw.
    """

    problem: str
    transformed: bool = False

    @property
    def label(self) -> str:
        """The function's name, with ``~t`` where it is transformed."""
        return f"{self.problem}~t" if self.transformed else self.problem

    @property
    def column(self) -> str:
        """The function's name as the thesis prints it."""
        return TITLES.get(self.problem, self.problem) + (" ~t" if self.transformed else "")

    def check(self) -> None:
        """Refuse an unknown function.

        Raises:
            InvalidSettingsError: naming those that are known.
        """
        checked_choice("problem", self.problem, (*ALL_FUNCTIONS, *CLASSIC_FUNCTIONS))

    def make(self, seed: int) -> Problem:
        """Build the function, transformed by the seed if it says so.

        Raises:
            InvalidSettingsError: the function is unknown.
        """
        build = get_classic if self.problem in CLASSIC_FUNCTIONS else get_problem
        problem = build(self.problem)
        return transform(problem, seed) if self.transformed else problem

    @contextmanager
    def open(self, seed: int) -> Iterator[Evaluator]:
        """Make the function of a seed."""
        problem = self.make(seed)
        space = SearchSpace(tuple(f"x{i}" for i in range(problem.dim)), problem.lower, problem.upper)
        yield Evaluator(space, problem)

    def wanted_set(self, seed: int) -> WantedSet:
        """All optima, a niche radius apart."""
        problem = self.make(seed)
        return WantedSet(problem.n_optima, problem.niche_radius)

    def told(self, method: str, seed: int) -> dict[str, Any]:
        """M and tau for the methods that need them: the thesis's, else all optima and half their smallest gap."""
        return _told(self.make(seed)) if method in TOLD_METHODS else {}

    def describe(self, trace: Trace, seed: int, budget: int) -> dict[str, Any]:
        """The counts of optima by every rule, as JSON values."""
        problem = self.make(seed)
        X, y = trace.X, trace.y
        score = thesis_score(problem, X, y, budget)
        variance = mean_batch_variance(X, trace.batches)
        return {
            "strict": {f"{a:g}": strict_count(problem, trace.solutions, a) for a in STRICT_ACCURACIES},
            "n_optima": problem.n_optima,
            "found": score.found,
            "found_values": score.found_values.tolist(),
            "first_all": score.first_all,
            "last_change": score.last_change,
            "curve": score.curve.tolist(),
            "text_count": text_count(problem, X, y),
            "basins": {f"{a:g}": strict_count(problem, X, a) for a in STRICT_ACCURACIES},
            "competition": {f"{a:g}": competition_count(problem, X, y, a) for a in STRICT_ACCURACIES},
            "batch_variance": None if variance is None else variance.tolist(),
        }


def _told(problem: Problem) -> dict[str, Any]:
    if problem.name in _THESIS_TAU:
        tau = _THESIS_TAU[problem.name]
        return {
            "num_solutions": _THESIS_M.get(problem.name, problem.n_optima),
            "min_distance": tau * problem.scale,
        }
    gaps = np.linalg.norm(problem.optima[:, None] - problem.optima[None], axis=2)
    gaps = gaps[gaps > 0.0]
    # A lone optimum has no gap; any distance will do then.
    tau = float(np.min(gaps)) if len(gaps) else float(np.max(problem.upper - problem.lower))
    return {"num_solutions": problem.n_optima, "min_distance": _OTHER_TAU_SHARE * tau}
