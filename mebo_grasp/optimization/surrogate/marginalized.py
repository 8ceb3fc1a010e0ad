"""A surrogate that averages over draws of its hyperparameters instead of trusting the most probable ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, standardize
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.relearning import RelearningSurrogate
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings, sample_hyperparameters


class MarginalizedSurrogate(RelearningSurrogate[MixtureProcess]):
    """Draws the hyperparameters anew every few iterations by slice sampling.

    Args:
        dim, relearn_period, kernel, noise: see ``RelearningSurrogate``.
        sampling: how many draws, how much burn-in.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self,
        dim: int,
        relearn_period: int = 5,
        kernel: Kernel = MATERN52,
        sampling: SamplingSettings | None = None,
        noise: LogNormalPrior | None = None,
    ) -> None:
        super().__init__(dim, relearn_period, kernel, noise)
        self._sampling = sampling or SamplingSettings()
        self._draws = [self._default]

    def posterior(self, observations: Observations) -> MixtureProcess:
        """Return the posterior given all values with the draws as they are."""
        return MixtureProcess.equal(
            [GaussianProcess.fit(observations.U, observations.y, h, self._kernel) for h in self._draws]
        )

    def _learn(self, observations: Observations, rng: np.random.Generator) -> None:
        z, _, _ = standardize(observations.y)
        current = self._draws[-1] if self._schedule.has_learned else None
        self._draws = sample_hyperparameters(observations.U, z, rng, self._kernel, current, self._sampling, self._noise)

    def _learned(self) -> dict[str, Any]:
        return {"draws": [draw.vector.tolist() for draw in self._draws]}

    def _restore_learned(self, state: dict[str, Any]) -> None:
        self._draws = self._draws_of(state["draws"])
