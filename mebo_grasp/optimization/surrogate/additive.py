"""Covariance functions that are sums over dimensions: f(u) = f_1(u_1) + … + f_d(u_d).

Where a function has this form, what is learned along one axis holds everywhere along the others, so n
values teach as much as n^d would a coupled kernel (Duvenaud et al. 2011, "Additive Gaussian processes",
the first-order member).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate import additive_pairs
from mebo_grasp.optimization.surrogate.kernels import (
    Kernel,
    LogNormalPrior,
    lengthscale_prior,
    parameter_count,
    signal_prior,
)


@dataclass(frozen=True)
class AdditiveKernel:
    """Sum of one-dimensional kernels, theta = (log l_1, …, log l_d, log s²_1, …, log s²_d).

    Args:
        name: its name.
        smooth: squared exponential instead of Matérn 5/2.
    """

    name: str
    smooth: bool = False

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of theta; the lengthscales' is that of one dimension."""
        one = lengthscale_prior(1)
        scales = LogNormalPrior(*(np.repeat(x, dim) for x in (one.mean, one.sd, one.lower, one.upper)))
        return scales + signal_prior(dim)

    @staticmethod
    def _split(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = len(theta) // 2
        return np.exp(-theta[:half]), np.exp(theta[half:])

    def matrix(self, A: FloatArray, U: FloatArray, theta: FloatArray) -> FloatArray:
        """Covariances k(a_i, u_j), shape (m, n)."""
        inverse, variances = self._split(theta)
        columns = np.ascontiguousarray((U * inverse).T)
        K: FloatArray = additive_pairs.additive_values(A * inverse, columns, variances, self.smooth)
        return K

    def diagonal(self, A: FloatArray, theta: FloatArray) -> FloatArray:
        """Variances, shape (m,)."""
        return np.full(len(A), np.sum(self._split(theta)[1]))

    def parameter_gradient(self, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_ij W_ij dk(u_i, u_j)/dtheta, shape (2 d,)."""
        inverse, variances = self._split(theta)
        columns = np.ascontiguousarray((U * inverse).T)
        sums: FloatArray = additive_pairs.additive_gradient_sums(columns, W, variances, self.smooth)
        return sums

    def input_gradient(self, A: FloatArray, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_j W_ij dk(a_i, u_j)/da_i, shape (m, d)."""
        inverse, variances = self._split(theta)
        columns = np.ascontiguousarray((U * inverse).T)
        scaled = A * inverse
        gradient: FloatArray = inverse * additive_pairs.additive_input_gradient(
            scaled, columns, variances, self.smooth, W
        )
        return gradient

    def sample_features(
        self, dim: int, theta: FloatArray, count: int, rng: np.random.Generator
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw random Fourier features, each of one dimension that is drawn in proportion to its variance."""
        inverse, variances = self._split(theta)
        owner = rng.choice(dim, count, p=variances / np.sum(variances))
        frequencies = rng.standard_normal(count) * inverse[owner]
        if not self.smooth:
            frequencies /= np.sqrt(rng.chisquare(5.0, count) / 5.0)
        phases = rng.uniform(0.0, 2.0 * np.pi, count)
        amplitude = np.sqrt(2.0 * np.sum(variances) / count)

        def features(A: FloatArray) -> FloatArray:
            values: FloatArray = amplitude * np.cos(A[:, owner] * frequencies + phases)
            return values

        return features


ADDITIVE_MATERN52 = AdditiveKernel("additive_matern52")
"""First-order additive Matérn 5/2."""

ADDITIVE_SQUARED_EXPONENTIAL = AdditiveKernel("additive_squared_exponential", smooth=True)
"""First-order additive squared exponential."""


@dataclass(frozen=True)
class SumKernel:
    """Sum of two kernels; theta = (the first's, the second's).

    Args:
        first: its parameters come first.
        second: the other one.
    """

    first: Kernel
    second: Kernel

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return f"{self.first.name}+{self.second.name}"

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of theta."""
        return self.first.prior(dim) + self.second.prior(dim)

    def _split(self, theta: FloatArray, dim: int) -> tuple[FloatArray, FloatArray]:
        size = parameter_count(self.first, dim)
        return theta[:size], theta[size:]

    def matrix(self, A: FloatArray, U: FloatArray, theta: FloatArray) -> FloatArray:
        """Covariances k(a_i, u_j), shape (m, n)."""
        one, two = self._split(theta, U.shape[1])
        K = self.first.matrix(A, U, one)
        K += self.second.matrix(A, U, two)
        return K

    def diagonal(self, A: FloatArray, theta: FloatArray) -> FloatArray:
        """Variances, shape (m,)."""
        one, two = self._split(theta, A.shape[1])
        return self.first.diagonal(A, one) + self.second.diagonal(A, two)

    def parameter_gradient(self, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_ij W_ij dk(u_i, u_j)/dtheta, shape (p,)."""
        one, two = self._split(theta, U.shape[1])
        return np.concatenate([self.first.parameter_gradient(U, one, W), self.second.parameter_gradient(U, two, W)])

    def input_gradient(self, A: FloatArray, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_j W_ij dk(a_i, u_j)/da_i, shape (m, d)."""
        one, two = self._split(theta, U.shape[1])
        gradient: FloatArray = self.first.input_gradient(A, U, one, W)
        return gradient + self.second.input_gradient(A, U, two, W)

    def sample_features(
        self, dim: int, theta: FloatArray, count: int, rng: np.random.Generator
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw half of the features from each kernel."""
        one, two = self._split(theta, dim)
        half = count // 2
        first = self.first.sample_features(dim, one, half, rng)
        second = self.second.sample_features(dim, two, count - half, rng)
        return lambda A: np.concatenate([first(A), second(A)], axis=1)
