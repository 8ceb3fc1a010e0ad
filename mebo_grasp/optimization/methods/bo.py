"""Classic Bayesian optimization: the maximizer of an acquisition function, one point after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mebo_grasp.errors import RunLogError
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
from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.methods.common import MethodBase, check_count, without_repeats
from mebo_grasp.optimization.methods.surrogate_choice import make_surrogate
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.surrogate.posterior import Posterior

N_LOCAL_CANDIDATES = 32
"""Points around the incumbent from which the acquisition is climbed as well."""


class SurrogateMethod(MethodBase):
    """What methods with one Gaussian process share: learning, the first point, and the state."""

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self.surrogate = make_surrogate(space.dim, settings)

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Fit the surrogate and choose the batch, shape (count, d)."""
        check_count(count)
        if observations.n == 0:
            self._phase = "no data"
            return rng.random((count, observations.dim))
        self._phase = self.name
        posterior = self.surrogate.update(observations, rng)
        points = self.select(posterior, observations, count, rng)
        return without_repeats(points, observations, rng)

    def predictor(self, observations: Observations) -> Callable[[FloatArray], FloatArray]:
        """The surrogate's mean."""
        return self.surrogate.posterior(observations).predict_mean

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose the batch on a fitted posterior, shape (count, d); methods override it."""
        del posterior, observations
        return rng.random((count, self.space.dim))

    def state(self) -> dict[str, Any]:
        """Phase and the surrogate's state."""
        return {**super().state(), "surrogate": self.surrogate.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        surrogate = state.get("surrogate")
        if not isinstance(surrogate, dict):
            raise RunLogError(f"the method's state needs the surrogate's, got {surrogate!r}")
        self.surrogate.restore(surrogate)


def around_incumbent(observations: Observations, rng: np.random.Generator) -> FloatArray:
    """Points close to the best observation, shape (N_LOCAL_CANDIDATES, d), some to each side of it."""
    best = observations.U[int(np.argmax(observations.y))]
    sds = np.geomspace(1e-4, 0.1, N_LOCAL_CANDIDATES)[:, None]
    points: FloatArray = np.clip(best + sds * rng.standard_normal((N_LOCAL_CANDIDATES, len(best))), 0.0, 1.0)
    return points


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
