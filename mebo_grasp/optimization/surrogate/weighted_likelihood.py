"""Hyperparameters of one region, learned from its own observations and, with less weight, from those around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.gaussian_process import (
    GaussianProcess,
    Hyperparameters,
    log_marginal_likelihood_and_gradient,
)
from mebo_grasp.optimization.surrogate.hyperparameters import climb, full_prior
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior, StationaryKernel


@dataclass(frozen=True, eq=False)
class Part:
    """Observations whose likelihood counts with a weight.

    Args:
        U: points, shape (n, d), unit cube.
        z: standardized values, shape (n,).
        weight: exponent of their likelihood.
    """

    U: FloatArray
    z: FloatArray
    weight: float


class WeightedPosterior:
    """Log posterior density of the hyperparameters (UBO paper, eq. 8), log-normal priors included.

    The parts are taken as independent of each other, which makes it a pseudo-likelihood.

    Args:
        parts: observations with weights; the region's own first.
        kernel: covariance function.
        signal_variance: that of standardized values, if it is not to be learned; for stationary kernels.
        noise: prior of the noise variance of standardized values; default that of a simulated trial.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        kernel: Kernel = MATERN52,
        signal_variance: float | None = None,
        noise: LogNormalPrior | None = None,
    ) -> None:
        self._parts = [part for part in parts if len(part.z) and part.weight > 0.0]
        self._kernel = kernel
        dim = parts[0].U.shape[1]
        self.prior = full_prior(dim, kernel, noise)
        if signal_variance is not None and isinstance(kernel, StationaryKernel):
            self.prior = self.prior.with_known(dim, float(np.log(signal_variance)))

    def __call__(self, vector: FloatArray) -> float:
        """Log density of (theta, log noise), shape (p + 1,); minus infinity outside of the prior's box."""
        if np.any(vector < self.prior.lower) or np.any(vector > self.prior.upper):
            return -np.inf
        value, _ = self.prior.log_density_and_gradient(vector)
        hyper = Hyperparameters.from_vector(vector)
        try:
            for part in self._parts:
                fitted = GaussianProcess.of_standardized(part.U, part.z, hyper, self._kernel)
                value += part.weight * fitted.log_marginal_likelihood()
        except InvalidSettingsError:
            return -np.inf
        return value

    def with_gradient(self, vector: FloatArray) -> tuple[float, FloatArray]:
        """Log density and gradient, shape (p + 1,).

        Raises:
            InvalidSettingsError: a covariance is not positive definite.
        """
        value, gradient = self.prior.log_density_and_gradient(vector)
        hyper = Hyperparameters.from_vector(vector)
        for part in self._parts:
            own, d_own = log_marginal_likelihood_and_gradient(part.U, part.z, hyper, self._kernel)
            value, gradient = value + part.weight * own, gradient + part.weight * d_own
        return value, gradient

    def most_probable(self, starts: Sequence[FloatArray], max_iterations: int = 40) -> Hyperparameters:
        """The best end of climbs from ``starts``, shape (p + 1,) each, by L-BFGS-B."""
        ends = [climb(self.with_gradient, self.prior, start, max_iterations) for start in starts]
        return Hyperparameters.from_vector(max(ends, key=lambda end: end[1])[0])
