"""A surrogate that averages over draws of its hyperparameters instead of trusting the most probable ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mebo_grasp.errors import RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel
from mebo_grasp.optimization.surrogate.relearning import RelearningSchedule
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings, sample_hyperparameters


@dataclass(frozen=True, eq=False)
class MarginalizedProcess:
    """Equal mixture of posteriors on the same data; mean and standard deviation are the mixture's.

    Args:
        members: at least one.
    """

    members: tuple[GaussianProcess, ...]

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return self.members[0].dim

    @property
    def n(self) -> int:
        """Number of observations."""
        return self.members[0].n

    @property
    def U(self) -> FloatArray:  # noqa: N802
        """Observed points, shape (n, d)."""
        return self.members[0].U

    @property
    def centre(self) -> float:
        """Mean of the observed values."""
        return self.members[0].centre

    @property
    def scale(self) -> float:
        """Standard deviation of the observed values."""
        return self.members[0].scale

    @property
    def noise_sd(self) -> float:
        """Root mean square of the members' noise, units of y."""
        return float(np.sqrt(np.mean([member.noise_sd**2 for member in self.members])))

    @property
    def hyperparameters(self) -> Hyperparameters:
        """Mean of the members' log parameters."""
        return Hyperparameters.from_vector(
            np.mean([member.hyperparameters.vector for member in self.members], axis=0)
        )

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, shape (m,) each, at A, shape (m, d): law of total variance."""
        parts = [member.predict(A) for member in self.members]
        means, sds = np.stack([mean for mean, _ in parts]), np.stack([sd for _, sd in parts])
        return means.mean(axis=0), np.sqrt(np.mean(sds**2, axis=0) + np.var(means, axis=0))

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Mean at A, shape (m, d). Returns shape (m,)."""
        mean: FloatArray = np.mean([member.predict_mean(A) for member in self.members], axis=0)
        return mean

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of the mean at A, shape (m, d)."""
        gradient: FloatArray = np.mean([member.mean_gradient(A) for member in self.members], axis=0)
        return gradient

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean and standard deviation with their gradients; see ``GaussianProcess``."""
        parts = [member.predict_with_gradients(A) for member in self.members]
        means, sds, d_means, d_sds = (np.stack([part[i] for part in parts]) for i in range(4))
        mean = means.mean(axis=0)
        sd = np.sqrt(np.mean(sds**2, axis=0) + np.var(means, axis=0))
        d_mean = d_means.mean(axis=0)
        # Half the derivative of the variance: mean of (sd d_sd + (mean_i - mean) d_mean_i).
        half = np.mean(sds[..., None] * d_sds + (means - mean)[..., None] * d_means, axis=0)
        return mean, sd, d_mean, half / sd[:, None]

    def condition_on(self, A: FloatArray, values: FloatArray) -> MarginalizedProcess:
        """Each member with further points A, shape (m, d), and values, shape (m,)."""
        return MarginalizedProcess(tuple(member.condition_on(A, values) for member in self.members))

    def sample_path(
        self, rng: np.random.Generator, n_features: int = 1024
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw one function: a member first, then a function of it."""
        return self.members[int(rng.integers(len(self.members)))].sample_path(rng, n_features)


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

    def update(self, observations: Observations, rng: np.random.Generator) -> MarginalizedProcess:
        """Return the posterior given all values; samples anew when due. To be called once an iteration."""
        due = self._schedule.is_due(observations.y)
        if due:
            z, _, _ = standardize(observations.y)
            current = self._draws[-1] if self._schedule.has_learned else None
            self._draws = sample_hyperparameters(
                observations.U, z, rng, self._kernel, current, self._sampling
            )
        self._schedule.count(due)
        return MarginalizedProcess(
            tuple(GaussianProcess.fit(observations.U, observations.y, h, self._kernel) for h in self._draws)
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
