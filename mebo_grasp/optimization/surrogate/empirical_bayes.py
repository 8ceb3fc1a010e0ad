"""A surrogate that relearns its hyperparameters every few iterations and refits with each new value."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.hyperparameters import LearningSettings, learn
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.relearning import RelearningSurrogate


class EmpiricalBayesSurrogate(RelearningSurrogate[GaussianProcess]):
    """Believes the most probable hyperparameters (thesis 7.2: relearned every 5 iterations).

    Args:
        dim, relearn_period, kernel, noise: see ``RelearningSurrogate``.
        learning: how the hyperparameters are sought.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self,
        dim: int,
        relearn_period: int = 5,
        kernel: Kernel = MATERN52,
        learning: LearningSettings | None = None,
        noise: LogNormalPrior | None = None,
    ) -> None:
        super().__init__(dim, relearn_period, kernel, noise)
        self._learning = learning or LearningSettings()
        self._hyperparameters = self._default

    @property
    def hyperparameters(self) -> Hyperparameters:
        """Those of the latest fit."""
        return self._hyperparameters

    def posterior(self, observations: Observations) -> GaussianProcess:
        """Return the posterior given all values with the hyperparameters as they are."""
        return GaussianProcess.fit(observations.U, observations.y, self._hyperparameters, self._kernel)

    def _learn(self, observations: Observations, rng: np.random.Generator) -> None:
        z, _, _ = standardize(observations.y)
        current = self._hyperparameters if self._schedule.has_learned else None
        self._hyperparameters, _ = learn(observations.U, z, self._kernel, current, rng, self._learning, self._noise)

    def _learned(self) -> dict[str, Any]:
        return {"vector": self._hyperparameters.vector.tolist()}

    def _restore_learned(self, state: dict[str, Any]) -> None:
        (self._hyperparameters,) = self._draws_of([state["vector"]])
