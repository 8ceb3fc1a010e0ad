"""A surrogate that averages over draws of its hyperparameters instead of trusting the most probable ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.errors import RunLogError
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.relearning import RelearningSchedule
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings, sample_hyperparameters


class MarginalizedSurrogate:
    """Draws the hyperparameters anew every few iterations by slice sampling.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one sampling to the next.
        kernel: covariance function.
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
    ) -> None:
        self._kernel = kernel
        self._schedule = RelearningSchedule(relearn_period)
        self._sampling = sampling or SamplingSettings()
        self._draws = [Hyperparameters.default(dim, kernel)]

    def update(self, observations: Observations, rng: np.random.Generator) -> MixtureProcess:
        """Return the posterior given all values; samples anew when due. To be called once an iteration."""
        due = self._schedule.is_due(observations.y)
        if due:
            z, _, _ = standardize(observations.y)
            current = self._draws[-1] if self._schedule.has_learned else None
            self._draws = sample_hyperparameters(
                observations.U, z, rng, self._kernel, current, self._sampling
            )
        self._schedule.count(due)
        return self.posterior(observations)

    def posterior(self, observations: Observations) -> MixtureProcess:
        """Return the posterior given all values with the draws as they are."""
        return MixtureProcess.equal(
            [GaussianProcess.fit(observations.U, observations.y, h, self._kernel) for h in self._draws]
        )

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return {
            "draws": [draw.vector.tolist() for draw in self._draws],
            "iterations_since_learning": self._schedule.iterations,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        try:
            vectors = np.array(state["draws"], dtype=np.float64)
            count = state["iterations_since_learning"]
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the surrogate's state is unreadable: {error!r}") from error
        expected = self._draws[0].vector.size
        if vectors.ndim != 2 or vectors.shape[1] != expected or not np.all(np.isfinite(vectors)):
            raise RunLogError(f"the surrogate's state needs draws of {expected} finite parameters")
        self._draws = [Hyperparameters.from_vector(vector) for vector in vectors]
        self._schedule.iterations = None if count is None else int(count)
