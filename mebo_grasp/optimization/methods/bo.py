"""Classic Bayesian optimization: the maximizer of an acquisition function, one point after the other."""

from __future__ import annotations

from abc import abstractmethod

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

PI_MARGIN = 0.01
"""What PI wants to improve on the best value by, standard deviations of the values."""


class GreedyOptimization(SurrogateMethod):
    """One acquisition function, maximized by DIRECT and L-BFGS-B.

    Points whose value is not known, because they are open or failed, and those already chosen for a batch enter the
    posterior with their mean as value ("believer", Ginsbourger et al. 2010), so that a batch spreads and a place
    where trials fail is left; Thompson sampling needs none of this for a batch, each draw being different.
    """

    is_log = False
    """Whether the worth is a logarithm: EI and PI are maximized by theirs, which have no flat tails."""

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Maximize the acquisition ``count`` times, shape (count, d)."""
        assumed = observations.without_value
        if len(assumed):
            posterior = posterior.condition_on(assumed, posterior.predict_mean(assumed))
        # What would have been found, had no trial failed, is no improvement; open trials are still to be told.
        would_be = posterior.predict_mean(observations.failed)
        incumbent = float(np.max(observations.y, initial=np.max(would_be, initial=-np.inf)))
        lower, upper = np.zeros(posterior.dim), np.ones(posterior.dim)
        points = np.empty((0, posterior.dim))
        for _ in range(count):
            worth = self._safe_worth(self.worth(posterior, incumbent, rng))
            point, _ = maximize(worth, lower, upper, rng, candidates=around_incumbent(observations, rng))
            points = np.concatenate([points, point[None]])
            if len(points) < count:
                posterior = posterior.condition_on(point[None], posterior.predict_mean(point[None]))
        return points

    def _safe_worth(self, worth: PointFunction) -> PointFunction:
        """The expected worth under input noise if that counts (UBO paper, eq. 13), else the worth itself."""
        if self.transform is None:
            return worth
        return LogUnscented(worth, self.transform) if self.is_log else Unscented(worth, self.transform)

    @abstractmethod
    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """The function to be maximized.

        Args:
            posterior: what is believed, points without a known value included.
            incumbent: the best value observed, units of y.
            rng: source of randomness.
        """


class BoEi(GreedyOptimization):
    """Greedy expected improvement."""

    name = "bo"
    is_log = True

    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """Log expected improvement by more than the margin of the settings."""
        del rng
        margin = self.settings.improvement_margin * posterior.scale
        return OnPosterior(LogExpectedImprovement(incumbent + margin), posterior)


class Ubo(BoEi):
    """Unscented Bayesian optimization: expected improvement, and solutions, as expected under input noise."""

    name = "ubo"
    safe = True


class BoPi(GreedyOptimization):
    """Greedy probability of improvement by 1 % of the values' spread or more."""

    name = "bo_pi"
    is_log = True

    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """Log probability of improvement."""
        del rng
        return OnPosterior(LogProbabilityOfImprovement(incumbent + PI_MARGIN * posterior.scale), posterior)


class BoUcb(GreedyOptimization):
    """Greedy upper confidence bound."""

    name = "bo_ucb"

    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """The bound."""
        del incumbent, rng
        return OnPosterior(UpperConfidenceBound(self.settings.ucb_beta), posterior)


class BoThompson(GreedyOptimization):
    """Thompson sampling by spectral features."""

    name = "bo_thompson"

    def worth(self, posterior: Posterior, incumbent: float, rng: np.random.Generator) -> PointFunction:
        """A function drawn from the posterior."""
        del incumbent
        return thompson(posterior, rng)
