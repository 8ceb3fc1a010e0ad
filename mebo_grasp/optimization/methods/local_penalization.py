"""Batches by local penalization of UCB (González et al. 2016; thesis appendix D)."""

from __future__ import annotations

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import OnPosterior
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.maximizer import MaximizerSettings, maximize
from mebo_grasp.optimization.methods.surrogate_method import SurrogateMethod, around_incumbent
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.selection.local_penalization import (
    LocalPenalizer,
    lipschitz_constant,
    penalized,
)
from mebo_grasp.optimization.surrogate.posterior import Posterior

SEARCH = MaximizerSettings(direct_evaluations=0, net_evaluations=512, refinements=3)
"""A net instead of DIRECT: the penalized worth changes with each point of a batch, and a net is one call."""


class LocalPenalization(SurrogateMethod):
    """UCB, made positive by softplus, times the penalties of the points that are open, failed or chosen before."""

    name = "local_penalization"

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Maximize the penalized acquisition ``count`` times, shape (count, d)."""
        lipschitz = lipschitz_constant(posterior, rng)
        penalizer = LocalPenalizer(posterior, float(np.max(observations.y)), lipschitz)
        if len(observations.without_value):
            penalizer.add(observations.without_value)
        bound = OnPosterior(UpperConfidenceBound(self.settings.ucb_beta), posterior)
        worth = penalized(bound, penalizer, posterior.centre, posterior.scale)
        lower, upper = np.zeros(posterior.dim), np.ones(posterior.dim)
        points = np.empty((0, posterior.dim))
        for _ in range(count):
            point, _ = maximize(worth, lower, upper, rng, SEARCH, around_incumbent(observations, rng))
            points = np.concatenate([points, point[None]])
            penalizer.add(point[None])
        return points
