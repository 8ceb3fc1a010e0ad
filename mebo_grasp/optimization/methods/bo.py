"""Classic Bayesian optimization: the maximizer of an acquisition function, one point after the other."""

from __future__ import annotations

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import OnPosterior, PointFunction
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import (
    LogExpectedImprovement,
    LogProbabilityOfImprovement,
)
from mebo_grasp.optimization.acquisition.maximizer import maximize
from mebo_grasp.optimization.acquisition.thompson import thompson
from mebo_grasp.optimization.acquisition.unscented import LogUnscented, Unscented
from mebo_grasp.optimization.methods.surrogate_method import SurrogateMethod, around_incumbent
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.posterior import Posterior


class GreedyOptimization(SurrogateMethod):
    """One acquisition function, maximized by DIRECT and L-BFGS-B.

    Points that are being evaluated, and those already chosen for a batch, enter the posterior with their
    mean as value ("believer", Ginsbourger et al. 2010), so that a batch spreads; Thompson sampling needs
    none of this, each draw being different.

    EI and PI are maximized by their logarithms, which have the same maximizer and no flat tails.
    """

    acquisition = "ei"

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Maximize the acquisition ``count`` times, shape (count, d)."""
        pending = observations.pending
        if len(pending):
            posterior = posterior.condition_on(pending, posterior.predict_mean(pending))
        incumbent = float(np.max(observations.y))
        lower, upper = np.zeros(posterior.dim), np.ones(posterior.dim)
        points = np.empty((0, posterior.dim))
        for _ in range(count):
            worth = self.safe_worth(self.worth(posterior, incumbent, rng))
            point, _ = maximize(worth, lower, upper, rng, candidates=around_incumbent(observations, rng))
            points = np.concatenate([points, point[None]])
            if len(points) < count:
                posterior = posterior.condition_on(point[None], posterior.predict_mean(point[None]))
        return points

    def safe_worth(self, worth: PointFunction) -> PointFunction:
        """The expected worth under input noise if that counts (UBO paper, eq. 13), else the worth itself."""
        if self.transform is None:
            return worth
        if self.acquisition in ("ei", "pi"):
            return LogUnscented(worth, self.transform)
        return Unscented(worth, self.transform)

    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """The function to be maximized."""
        if self.acquisition == "thompson":
            return thompson(posterior, rng)
        if self.acquisition == "pi":
            return OnPosterior(LogProbabilityOfImprovement(incumbent + 0.01 * posterior.scale), posterior)
        if self.acquisition == "ucb":
            return OnPosterior(UpperConfidenceBound(self.settings.ucb_beta), posterior)
        margin = self.settings.improvement_margin * posterior.scale
        return OnPosterior(LogExpectedImprovement(incumbent + margin), posterior)


class BoEi(GreedyOptimization):
    """Greedy expected improvement."""

    name = "bo"


class Ubo(GreedyOptimization):
    """Unscented Bayesian optimization: expected improvement, and solutions, as expected under input noise."""

    name = "ubo"
    safe = True


class BoPi(GreedyOptimization):
    """Greedy probability of improvement by 1 % of the values' spread or more."""

    name = "bo_pi"
    acquisition = "pi"


class BoUcb(GreedyOptimization):
    """Greedy upper confidence bound."""

    name = "bo_ucb"
    acquisition = "ucb"


class BoThompson(GreedyOptimization):
    """Thompson sampling by spectral features."""

    name = "bo_thompson"
    acquisition = "thompson"
