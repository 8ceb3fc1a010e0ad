"""A method on the common posterior: it learns a surrogate and chooses the batch on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.base import MethodSettings, state_part
from mebo_grasp.optimization.methods.common import MethodBase, check_count, without_repeats
from mebo_grasp.optimization.methods.surrogate_choice import make_surrogate
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.surrogate.posterior import Posterior

N_LOCAL_CANDIDATES = 32
"""Points around the incumbent from which the acquisition is climbed as well."""


class SurrogateMethod(MethodBase, ABC):
    """What methods on the common posterior share: learning, the first point, and the state.

    Args:
        space: the search space.
        settings: settings of the run; they name the surrogate.
    """

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

    @abstractmethod
    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose the batch on a posterior of at least one value, shape (count, d), unit cube."""

    def state(self) -> dict[str, Any]:
        """Phase and the surrogate's state."""
        return {**super().state(), "surrogate": self.surrogate.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self.surrogate.restore(state_part(state, "surrogate"))


def around_incumbent(observations: Observations, rng: np.random.Generator) -> FloatArray:
    """Points close to the best observation, shape (N_LOCAL_CANDIDATES, d), some to each side of it."""
    best = observations.U[int(np.argmax(observations.y))]
    sds = np.geomspace(1e-4, 0.1, N_LOCAL_CANDIDATES)[:, None]
    points: FloatArray = np.clip(best + sds * rng.standard_normal((N_LOCAL_CANDIDATES, len(best))), 0.0, 1.0)
    return points
