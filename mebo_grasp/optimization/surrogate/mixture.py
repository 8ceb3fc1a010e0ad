"""A posterior that is a mixture of Gaussian processes on the same data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess


@dataclass(frozen=True, eq=False)
class MixtureProcess:
    """Mixture of posteriors; mean and standard deviation are the mixture's, by the law of total variance.

    Members differ in hyperparameters (Monte Carlo draws) or in structure as well (chosen by evidence).

    Args:
        members: at least one, all of the same observations.
        shares: weight of each, shape (len(members),), sum 1.
    """

    members: tuple[GaussianProcess, ...]
    shares: FloatArray

    @classmethod
    def equal(cls, members: Sequence[GaussianProcess]) -> MixtureProcess:
        """The mixture in which all members weigh the same."""
        return cls(tuple(members), np.full(len(members), 1.0 / len(members)))

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
        return float(np.sqrt(self._mean([member.noise_sd**2 for member in self.members])))

    @property
    def lengthscales(self) -> FloatArray:
        """Geometric mean of the members' lengthscales, shape (d,)."""
        return np.exp(self._mean([np.log(member.lengthscales) for member in self.members]))

    def _mean(self, parts: Sequence[FloatArray] | Sequence[float]) -> FloatArray:
        """Mean over the members of what each contributes, all of the same shape."""
        mean: FloatArray = np.tensordot(self.shares, np.stack(parts), axes=1)
        return mean

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, shape (m,) each, at A, shape (m, d)."""
        means, sds = zip(*(member.predict(A) for member in self.members), strict=True)
        mean = self._mean(means)
        return mean, np.sqrt(self._variance(mean, means, sds))

    def _variance(self, mean: FloatArray, means: Sequence[FloatArray], sds: Sequence[FloatArray]) -> FloatArray:
        return self._mean([sd**2 + (own - mean) ** 2 for own, sd in zip(means, sds, strict=True)])

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Mean at A, shape (m, d). Returns shape (m,)."""
        return self._mean([member.predict_mean(A) for member in self.members])

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of the mean at A, shape (m, d)."""
        return self._mean([member.mean_gradient(A) for member in self.members])

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean and standard deviation with their gradients; see ``GaussianProcess``."""
        parts = [member.predict_with_gradients(A) for member in self.members]
        means, sds, d_means, _ = zip(*parts, strict=True)
        mean = self._mean(means)
        sd = np.sqrt(self._variance(mean, means, sds))
        # Half the derivative of the variance: mean of (sd d_sd + (mean_i - mean) d_mean_i).
        half = self._mean([own[1][:, None] * own[3] + (own[0] - mean)[:, None] * own[2] for own in parts])
        return mean, sd, self._mean(d_means), half / sd[:, None]

    def condition_on(self, A: FloatArray, values: FloatArray) -> MixtureProcess:
        """Each member with further points A, shape (m, d), and values, shape (m,)."""
        return MixtureProcess(tuple(m.condition_on(A, values) for m in self.members), self.shares)

    def sample_path(self, rng: np.random.Generator, n_features: int = 1024) -> Callable[[FloatArray], FloatArray]:
        """Draw one function: a member by its share first, then a function of it."""
        member = self.members[int(rng.choice(len(self.members), p=self.shares))]
        return member.sample_path(rng, n_features)
