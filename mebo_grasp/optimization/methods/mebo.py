"""MEBO: a batch drawn from the Boltzmann policy, one query by EI and two by UCB (thesis 5.2 and 7.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import Acquisition
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement
from mebo_grasp.optimization.methods.base import MethodSettings, state_int
from mebo_grasp.optimization.methods.surrogate_method import SurrogateMethod
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.boltzmann import BoltzmannSettings, draw
from mebo_grasp.optimization.surrogate.posterior import Posterior

EXPLORATIVE_SHARE = 0.7
"""Share of a batch drawn by UCB (thesis 7.2: about 70 %, two of three)."""


class Mebo(SurrogateMethod):
    """Multisolution explorative Bayesian optimization.

    Needs neither the number of solutions nor a diversity level. Queries of a batch are drawn
    independently from the same posterior; no coordinator is needed between several optimizers.

    Args:
        space: the search space.
        settings: settings of the run.
    """

    name = "mebo"

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self.boltzmann = BoltzmannSettings(
            settings.boltzmann_beta, settings.burn_in, settings.chains, settings.proportional_selection
        )
        self._proposed = 0

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return queries drawn from the Boltzmann policy, shape (count, d)."""
        points = super().propose(observations, count, rng)
        self._proposed += count if observations.n else 0
        return points

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose the batch on a fitted posterior, shape (count, d)."""
        self._phase = "boltzmann"
        acquisitions = self.acquisitions(observations, count)
        return draw(posterior, acquisitions, rng, self.boltzmann, transform=self.transform)[:, 0]

    def acquisitions(self, observations: Observations, count: int) -> Sequence[Acquisition]:
        """One acquisition a slot: EI for the exploitative share of each batch, UCB for the rest.

        Slots are counted over the run, so single asks keep the same proportion as whole batches.
        """
        batch = self.settings.batch_size
        n_exploitative = max(1, round((1.0 - EXPLORATIVE_SHARE) * batch)) if batch > 1 else 1
        improvement = ExpectedImprovement(float(np.max(observations.y)))
        bound = UpperConfidenceBound(self.settings.ucb_beta)
        period = batch if batch > 1 else 3
        slots = [(self._proposed + i) % period for i in range(count)]
        return [improvement if slot < n_exploitative else bound for slot in slots]

    def state(self) -> dict[str, Any]:
        """Phase, the surrogate's state and the number of points proposed so far."""
        return {**super().state(), "proposed": self._proposed}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self._proposed = state_int(state, "proposed")
