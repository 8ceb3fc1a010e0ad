"""A surrogate that relearns its hyperparameters every few iterations and refits with each new value."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.errors import RunLogError
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.hyperparameters import LearningSettings, learn
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.relearning import RelearningSchedule


class EmpiricalBayesSurrogate:
    """Keeps the hyperparameters between iterations (thesis 7.2: relearned every 5 iterations).

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning to the next.
        kernel: covariance function.
        learning: how the hyperparameters are sought.
        noise: prior of the noise variance of standardized values; default that of a simulated trial.

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
        self._kernel = kernel
        self._schedule = RelearningSchedule(relearn_period)
        self._learning = learning or LearningSettings()
        self._noise = noise
        self._hyperparameters = Hyperparameters.default(dim, kernel)

    @property
    def hyperparameters(self) -> Hyperparameters:
        """Those of the latest fit."""
        return self._hyperparameters

    def update(self, observations: Observations, rng: np.random.Generator) -> GaussianProcess:
        """Return the posterior given all values; relearns when due. To be called once an iteration."""
        due = self._schedule.is_due(observations.y)
        if due:
            z, _, _ = standardize(observations.y)
            current = self._hyperparameters if self._schedule.has_learned else None
            self._hyperparameters, _ = learn(
                observations.U, z, self._kernel, current, rng, self._learning, self._noise
            )
        self._schedule.count(due)
        return self.posterior(observations)

    def posterior(self, observations: Observations) -> GaussianProcess:
        """Return the posterior given all values with the hyperparameters as they are."""
        return GaussianProcess.fit(observations.U, observations.y, self._hyperparameters, self._kernel)

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return {
            "vector": self._hyperparameters.vector.tolist(),
            "iterations_since_learning": self._schedule.iterations,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        try:
            vector = np.array(state["vector"], dtype=np.float64)
            count = state["iterations_since_learning"]
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the surrogate's state is unreadable: {error!r}") from error
        if vector.shape != self._hyperparameters.vector.shape or not np.all(np.isfinite(vector)):
            raise RunLogError(
                f"the surrogate's state needs {self._hyperparameters.vector.size} finite parameters, "
                f"got {vector.tolist()}"
            )
        self._hyperparameters = Hyperparameters.from_vector(vector)
        self._schedule.iterations = None if count is None else int(count)
