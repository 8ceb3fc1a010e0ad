"""E-MEBO: MEBO with explorative sampling, always at first and then in one iteration of three (thesis 5.2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.base import state_int
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.selection.boltzmann import draw
from mebo_grasp.optimization.selection.explorative import most_distant_subset
from mebo_grasp.optimization.surrogate.posterior import Posterior

CANDIDATES_PER_POINT = 5
"""Candidates T drawn for each point of a batch (thesis 5.2; its code uses 5)."""

EXPLORATIVE_UNTIL = 0.4
"""Share of the budget up to which every iteration is explorative."""


class EMebo(Mebo):
    """Explorative MEBO: of T candidates a point, the batch is the subset that lies farthest apart."""

    name = "e_mebo"

    _iteration = 0

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose the batch by the schedule, shape (count, d)."""
        explorative = self.spent(observations) < EXPLORATIVE_UNTIL or self._iteration % 3 == 2
        self._iteration += 1
        if explorative:
            return self.explorative(posterior, observations, count, rng)
        return super().select(posterior, observations, count, rng)

    def spent(self, observations: Observations) -> float:
        """Share of the budget that has been asked for."""
        return len(observations.taken) / self.settings.budget

    def explorative(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Draw T candidates a point and keep the most distant subset, shape (count, d)."""
        self._phase = "explorative"
        acquisitions = self.acquisitions(observations, count)
        candidates = draw(posterior, acquisitions, rng, self.boltzmann, CANDIDATES_PER_POINT, transform=self.transform)
        candidates = candidates.reshape(-1, posterior.dim)
        return candidates[most_distant_subset(candidates, count)]

    def state(self) -> dict[str, Any]:
        """That of MEBO and the iteration."""
        return {**super().state(), "iteration": self._iteration}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self._iteration = state_int(state, "iteration")
