"""Covariance functions with automatic relevance determination and their analytic gradients.

Notation: U, shape (n, d), and A, shape (m, d), are points in the unit cube. ``theta`` is a kernel's
parameter vector; its entries are logarithms, but for the places and angles of a map of the inputs, so that every real
vector is valid. For an ARD kernel it is (log l_1, …, log l_d, log s²) with lengthscales l and signal variance s².
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate import pairwise


@dataclass(frozen=True, eq=False)
class LogNormalPrior:
    """Independent normal priors on log parameters, with the box in which they are sought.

    Args:
        mean: of the logarithms, shape (p,).
        sd: of the logarithms, shape (p,).
        lower, upper: bounds on the logarithms, shape (p,) each.
    """

    mean: FloatArray
    sd: FloatArray
    lower: FloatArray
    upper: FloatArray

    def log_density_and_gradient(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log density up to a constant, and its gradient, shape (p,)."""
        z = (theta - self.mean) / self.sd
        return -0.5 * float(z @ z), -z / self.sd

    def __add__(self, other: LogNormalPrior) -> LogNormalPrior:
        return LogNormalPrior(
            np.concatenate([self.mean, other.mean]),
            np.concatenate([self.sd, other.sd]),
            np.concatenate([self.lower, other.lower]),
            np.concatenate([self.upper, other.upper]),
        )

    def with_known(self, index: int, value: float) -> LogNormalPrior:
        """The same with one parameter that is known, its logarithm given."""
        mean, lower, upper = self.mean.copy(), self.lower.copy(), self.upper.copy()
        mean[index] = lower[index] = upper[index] = value
        return LogNormalPrior(mean, self.sd, lower, upper)

    @property
    def unknown(self) -> npt.NDArray[np.int64]:
        """Indices of the parameters that are not known."""
        return np.flatnonzero(self.lower < self.upper)

    @classmethod
    def repeated(cls, count: int, median: float, sd: float, lower: float, upper: float) -> LogNormalPrior:
        """The same prior for ``count`` parameters; median and bounds are given for the parameter itself."""
        ones = np.ones(count)
        return cls(np.log(median) * ones, sd * ones, np.log(lower) * ones, np.log(upper) * ones)


LENGTHSCALE_MEDIAN, LENGTHSCALE_SD = 0.4, 1.0
SIGNAL_SD = 1.5


def lengthscale_prior(dim: int) -> LogNormalPrior:
    """Prior of one lengthscale a dimension, in units of the cube's side.

    The median grows with the root of the dimension, as the distances between points do; the spread is
    wide enough for a function with twenty periods a side (l about 0.02) to cost only two nats a dimension.
    """
    return LogNormalPrior.repeated(dim, LENGTHSCALE_MEDIAN * np.sqrt(dim), LENGTHSCALE_SD, 5e-3, 50.0)


def signal_prior(count: int = 1) -> LogNormalPrior:
    """Prior of signal variances on standardized values."""
    return LogNormalPrior.repeated(count, 1.0 / count, SIGNAL_SD, 1e-3, 1e3)


class Kernel(Hashable, Protocol):
    """A covariance function; stateless, its parameters are passed to each call."""

    @property
    def name(self) -> str:
        """Name for logs and reports."""

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of theta, p parameters for ``dim`` dimensions."""

    def matrix(self, A: FloatArray, U: FloatArray, theta: FloatArray) -> FloatArray:
        """Covariances k(a_i, u_j), shape (m, n)."""

    def diagonal(self, A: FloatArray, theta: FloatArray) -> FloatArray:
        """Variances k(a_i, a_i), shape (m,)."""

    def parameter_gradient(self, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_ij W_ij dk(u_i, u_j)/dtheta, shape (p,), for a symmetric W, shape (n, n).

        Only the upper triangle of W is read.
        """

    def input_gradient(self, A: FloatArray, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_j W_ij dk(a_i, u_j)/da_i, shape (m, d), for W, shape (m, n)."""

    def sample_features(
        self, dim: int, theta: FloatArray, count: int, rng: np.random.Generator
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw random features phi, points (m, d) -> (m, count), with E[phi(a) phi(b)] = k(a, b)."""


class Parametrized(Hashable, Protocol):
    """A kernel, or a part of one, that knows the prior of its parameters."""

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior of the parameters for ``dim`` dimensions."""


@cache
def parameter_count(part: Parametrized, dim: int) -> int:
    """Number of parameters for ``dim`` dimensions. Asked for at each evaluation, hence remembered."""
    return len(part.prior(dim).mean)


_PairLoop = Callable[[FloatArray, FloatArray, float], FloatArray]


@dataclass(frozen=True)
class StationaryKernel:
    """An ARD kernel of the scaled distance r² = sum_q (a_q - b_q)² / l_q².

    Args:
        name: its name.
        values: compiled loop for the covariances.
        slope: compiled loop for S in dk/da_q = -S (a_q - b_q) / l_q².
        gradient_sums: compiled loop for the gradient by the parameters.
        degrees_of_freedom: of the spectral density (a multivariate t); infinity for a normal one.
    """

    name: str
    values: _PairLoop
    slope: _PairLoop
    gradient_sums: _PairLoop
    degrees_of_freedom: float

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of (log l_1, …, log l_d, log s²)."""
        return lengthscale_prior(dim) + signal_prior()

    def matrix(self, A: FloatArray, U: FloatArray, theta: FloatArray) -> FloatArray:
        """Covariances k(a_i, u_j), shape (m, n)."""
        inverse = np.exp(-theta[:-1])
        return self.values(A * inverse, np.ascontiguousarray((U * inverse).T), float(np.exp(theta[-1])))

    def diagonal(self, A: FloatArray, theta: FloatArray) -> FloatArray:
        """Variances, shape (m,)."""
        return np.full(len(A), np.exp(theta[-1]))

    def parameter_gradient(self, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_ij W_ij dk(u_i, u_j)/dtheta, shape (d + 1,)."""
        transposed = np.ascontiguousarray((U * np.exp(-theta[:-1])).T)
        return self.gradient_sums(transposed, W, float(np.exp(theta[-1])))

    def input_gradient(self, A: FloatArray, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_j W_ij dk(a_i, u_j)/da_i, shape (m, d)."""
        inverse = np.exp(-theta[:-1])
        scaled, transposed = A * inverse, np.ascontiguousarray((U * inverse).T)
        S = self.slope(scaled, transposed, float(np.exp(theta[-1])))
        gradient: FloatArray = -pairwise.weighted_differences(scaled, transposed, W, S) * inverse
        return gradient

    def sample_features(
        self, dim: int, theta: FloatArray, count: int, rng: np.random.Generator
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw random Fourier features (Rahimi and Recht 2007) of the kernel."""
        frequencies = rng.standard_normal((dim, count)) * np.exp(-theta[:-1])[:, None]
        if np.isfinite(self.degrees_of_freedom):
            # A multivariate t vector is a normal one over the root of an independent chi-square / nu.
            nu = self.degrees_of_freedom
            frequencies /= np.sqrt(rng.chisquare(nu, count) / nu)
        phases = rng.uniform(0.0, 2.0 * np.pi, count)
        amplitude = np.sqrt(2.0 * np.exp(theta[-1]) / count)

        def features(A: FloatArray) -> FloatArray:
            values: FloatArray = amplitude * np.cos(A @ frequencies + phases)
            return values

        return features


MATERN52 = StationaryKernel(
    "matern52", pairwise.matern52, pairwise.matern52_slope, pairwise.matern52_gradient_sums, 5.0
)
"""Matérn 5/2 with ARD (thesis, section 3.2)."""

SQUARED_EXPONENTIAL = StationaryKernel(
    "squared_exponential",
    pairwise.squared_exponential,
    pairwise.squared_exponential,
    pairwise.squared_exponential_gradient_sums,
    float("inf"),
)
"""Squared exponential with ARD (thesis, section 3.2)."""
