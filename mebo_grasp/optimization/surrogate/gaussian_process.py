"""Exact Gaussian-process regression with a zero mean on standardized values (thesis, section 3.2).

Notation: U (n, d) observed points in the unit cube, y (n,) their values, z = (y - centre) / scale the
standardized values, K (n, n) their covariance with the noise variance on the diagonal, L its lower
Cholesky factor, weights = K⁻¹ z. Values that come out are in the units of y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import blas, lapack

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate import pairwise
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel

_CHUNK = 512
"""Rows predicted at once; keeps the covariances of n = 250 within the second-level cache, and those of n = 2,000
with the thousands of points of a search net within megabytes."""

_VARIANCE_FLOOR = 1e-12
"""Smallest posterior variance as a share of the prior variance: rounding can take it below zero."""


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """What is learned from the data.

    Args:
        theta: the kernel's log parameters, shape (p,).
        log_noise: log of the noise variance of standardized values.
    """

    theta: FloatArray
    log_noise: float

    @property
    def vector(self) -> FloatArray:
        """(theta, log_noise), shape (p + 1,)."""
        return np.append(self.theta, self.log_noise)

    @classmethod
    def from_vector(cls, vector: FloatArray) -> Hyperparameters:
        """Split (theta, log_noise), shape (p + 1,)."""
        return cls(np.array(vector[:-1], dtype=np.float64), float(vector[-1]))

    @classmethod
    def default(cls, dim: int, kernel: Kernel = MATERN52) -> Hyperparameters:
        """The prior's medians with a noise variance of 1e-4: what is believed before any value is known."""
        return cls(kernel.prior(dim).mean.copy(), float(np.log(1e-4)))


def standardize(y: FloatArray) -> tuple[FloatArray, float, float]:
    """Return (z, centre, scale) with z = (y - centre) / scale; equal values get scale 1."""
    magnitude = float(np.max(np.abs(y))) if len(y) else 0.0
    if magnitude == 0.0:
        return np.zeros(len(y)), 0.0, 1.0
    # Sums of squares of huge values overflow, so moments are taken of values in [-1, 1].
    relative = y / magnitude
    centre, spread = float(np.mean(relative)), float(np.std(relative))
    if spread <= 1e-14:
        return np.zeros(len(y)), float(y[0]), 1.0
    return (relative - centre) / spread, centre * magnitude, spread * magnitude


def cholesky(K: FloatArray) -> FloatArray:
    """Lower Cholesky factor, shape (n, n), Fortran order, upper part zero.

    A matrix that rounding has made indefinite gets the smallest of a few growing jitters on its diagonal.

    Raises:
        InvalidSettingsError: the matrix is not finite or far from positive definite.
    """
    jitter = 0.0
    scale = float(np.mean(np.diag(K)))
    for _ in range(8):
        # K is symmetric, so its transpose is K in the order that LAPACK wants: no copy is reordered.
        L, info = lapack.dpotrf((K + jitter * np.eye(len(K)) if jitter else K).T, lower=1, clean=1)
        if info == 0 and np.all(np.isfinite(np.diag(L))):
            factor: FloatArray = L
            return factor
        jitter = scale * 1e-10 if jitter == 0.0 else jitter * 10.0
    raise InvalidSettingsError(
        f"the covariance of {len(K)} points is not positive definite; the hyperparameters are implausible"
    )


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A fitted posterior; immutable. Build it with ``GaussianProcess.fit``."""

    kernel: Kernel
    hyperparameters: Hyperparameters
    U: FloatArray
    z: FloatArray
    centre: float
    scale: float
    L: FloatArray
    weights: FloatArray

    @classmethod
    def fit(
        cls,
        U: FloatArray,
        y: FloatArray,
        hyperparameters: Hyperparameters | None = None,
        kernel: Kernel = MATERN52,
    ) -> GaussianProcess:
        """Condition on data; n = 0 gives the prior.

        Args:
            U: points in the unit cube, shape (n, d).
            y: values, shape (n,).
            hyperparameters: those of ``kernel``; default its prior medians.
            kernel: covariance function.

        Raises:
            InvalidSettingsError: shapes contradict each other or a number is not finite.
        """
        U, y = np.array(U, dtype=np.float64), np.asarray(y, dtype=np.float64)
        if U.ndim != 2 or y.shape != (len(U),) or not (np.all(np.isfinite(U)) and np.all(np.isfinite(y))):
            raise InvalidSettingsError(f"need finite U (n, d) and y (n,), got shapes {U.shape} and {y.shape}")
        hyper = hyperparameters or Hyperparameters.default(U.shape[1], kernel)
        z, centre, scale = standardize(y)
        return replace(cls.of_standardized(U, z, hyper, kernel), centre=centre, scale=scale)

    @classmethod
    def of_standardized(
        cls, U: FloatArray, z: FloatArray, hyper: Hyperparameters, kernel: Kernel = MATERN52
    ) -> GaussianProcess:
        """Condition on values that are standardized already; the posterior is in the same units.

        Raises:
            InvalidSettingsError: the covariance is not positive definite.
        """
        if len(U) == 0:
            return cls(kernel, hyper, U, z, 0.0, 1.0, np.empty((0, 0)), np.empty(0))
        K = kernel.matrix(U, U, hyper.theta)
        K.flat[:: len(K) + 1] += np.exp(hyper.log_noise)
        L = cholesky(K)
        weights, _ = lapack.dpotrs(L, z, lower=1)
        return cls(kernel, hyper, U, z, 0.0, 1.0, L, weights)

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.U)

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return int(self.U.shape[1])

    @property
    def y(self) -> FloatArray:
        """Observed values, shape (n,)."""
        return self.z * self.scale + self.centre

    @property
    def noise_sd(self) -> float:
        """Standard deviation of the learned observation noise, units of y."""
        return self.scale * float(np.exp(0.5 * self.hyperparameters.log_noise))

    @property
    def lengthscales(self) -> FloatArray:
        """Lengthscales, shape (d,): every kernel's parameters begin with their logarithms."""
        return np.exp(self.hyperparameters.theta[: self.dim])

    @cached_property
    def _inverse_factor(self) -> FloatArray:
        inverse, _ = lapack.dtrtri(self.L, lower=1)
        result: FloatArray = inverse
        return result

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posterior mean and standard deviation of the noise-free function.

        Args:
            A: points in the unit cube, shape (m, d).

        Returns:
            (mean, sd), each shape (m,), units of y; sd is positive.
        """
        mean, sd = np.empty(len(A)), np.empty(len(A))
        theta = self.hyperparameters.theta
        for start in range(0, len(A), _CHUNK):
            chunk = slice(start, start + _CHUNK)
            prior = self.kernel.diagonal(A[chunk], theta)
            if self.n == 0:
                mean[chunk], sd[chunk] = 0.0, np.sqrt(prior)
                continue
            K = self.kernel.matrix(A[chunk], self.U, theta)
            mean[chunk] = K @ self.weights
            V = blas.dtrmm(1.0, self._inverse_factor, K.T, lower=1, overwrite_b=1)
            explained = np.einsum("ij,ij->j", V, V)
            sd[chunk] = np.sqrt(np.maximum(prior - explained, _VARIANCE_FLOOR * prior))
        return mean * self.scale + self.centre, sd * self.scale

    def predict_observed(self) -> tuple[FloatArray, FloatArray]:
        """What ``predict`` returns at the observed points themselves, shape (n,) each, without their covariances.

        With the noise variance v the mean is z - v K⁻¹ z and the variance v - v² diag(K⁻¹).
        """
        if self.n == 0:
            return np.empty(0), np.empty(0)
        prior = self.kernel.diagonal(self.U, self.hyperparameters.theta)
        # By the factor itself, so that a jitter counts.
        noise = self.L[0, 0] ** 2 - prior[0]
        precision = np.einsum("ij,ij->j", self._inverse_factor, self._inverse_factor)
        variance = np.maximum(noise - noise**2 * precision, _VARIANCE_FLOOR * prior)
        mean = self.z - noise * self.weights
        return mean * self.scale + self.centre, np.sqrt(variance) * self.scale

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Posterior mean at A, shape (m, d); much cheaper than ``predict``. Returns shape (m,)."""
        A = np.asarray(A, dtype=np.float64)
        mean = np.zeros(len(A))
        if self.n:
            for start in range(0, len(A), _CHUNK):
                chunk = slice(start, start + _CHUNK)
                mean[chunk] = self.kernel.matrix(A[chunk], self.U, self.hyperparameters.theta) @ self.weights
        return mean * self.scale + self.centre

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of the posterior mean at A, shape (m, d), units of y per side of the cube."""
        if self.n == 0:
            return np.zeros_like(A)
        W = np.broadcast_to(self.weights, (len(A), self.n))
        gradient = self.kernel.input_gradient(A, self.U, self.hyperparameters.theta, np.ascontiguousarray(W))
        return gradient * self.scale

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Posterior mean and standard deviation with their gradients.

        Args:
            A: points in the unit cube, shape (m, d).

        Returns:
            (mean (m,), sd (m,), d mean (m, d), d sd (m, d)), units of y (per side of the cube).
        """
        if self.n == 0:
            return *self.predict(A), np.zeros_like(A), np.zeros_like(A)
        theta = self.hyperparameters.theta
        K = self.kernel.matrix(A, self.U, theta)
        inverse = self._inverse_factor
        if len(A) == 1:
            # A single point is bound by memory, and this reads half as much as the general product.
            half = blas.dtrmv(inverse, K[0], lower=1)
            solved = blas.dtrmv(inverse, half, lower=1, trans=1)[:, None]
            explained = np.array([half @ half])
        else:
            V = blas.dtrmm(1.0, inverse, K.T, lower=1)
            solved = blas.dtrmm(1.0, inverse, V, lower=1, trans_a=1)
            explained = np.einsum("ij,ij->j", V, V)
        prior = self.kernel.diagonal(A, theta)
        mean = (K @ self.weights) * self.scale + self.centre
        sd = np.sqrt(np.maximum(prior - explained, _VARIANCE_FLOOR * prior)) * self.scale
        # Both gradients in one call: for a single point the call costs more than what it computes.
        W = np.concatenate([solved.T, np.broadcast_to(self.weights, K.shape)])
        both = self.kernel.input_gradient(np.concatenate([A, A]), self.U, theta, W)
        # The prior variance is constant for all kernels here, so only the explained part varies.
        d_variance, d_mean = -2.0 * both[: len(A)], both[len(A) :] * self.scale
        d_sd = d_variance * (self.scale**2 / (2.0 * sd))[:, None]
        return mean, sd, d_mean, d_sd

    def condition_on(self, A: FloatArray, values: FloatArray) -> GaussianProcess:
        """Return the posterior with further points A, shape (m, d), and values, shape (m,), units of y.

        Hyperparameters and standardization stay; meant for points whose value is assumed ("believer").
        """
        U = np.concatenate([self.U, A])
        z = np.concatenate([self.z, (np.asarray(values) - self.centre) / self.scale])
        L = self._extended_factor(A)
        weights, _ = lapack.dpotrs(L, z, lower=1)
        extended = replace(self, U=U, z=z, L=L, weights=weights)
        if "_inverse_factor" in vars(self):
            # Where this posterior was asked for variances, so will be the next: k rows cost n², a new inverse n³.
            vars(extended)["_inverse_factor"] = self._extended_inverse(L)
        return extended

    def _extended_inverse(self, L: FloatArray) -> FloatArray:
        """Inverse of a factor L that is this one's with k rows added: this one's inverse with k rows added."""
        n = self.n
        corner = np.asfortranarray(L[n:, n:])
        inverse = np.zeros_like(L)
        inverse[:n, :n] = self._inverse_factor
        inverse[n:, n:], _ = lapack.dtrtri(corner, lower=1)
        carried = blas.dtrmm(1.0, self._inverse_factor, L[n:, :n], side=1, lower=1)
        inverse[n:, :n] = blas.dtrsm(-1.0, corner, carried, lower=1)
        return inverse

    def _extended_factor(self, A: FloatArray) -> FloatArray:
        """Cholesky factor with further points A, shape (k, d): the old one with k rows added."""
        theta = self.hyperparameters.theta
        corner = self.kernel.matrix(A, A, theta)
        corner.flat[:: len(A) + 1] += np.exp(self.hyperparameters.log_noise)
        if self.n == 0:
            return cholesky(corner)
        rows = blas.dtrsm(1.0, self.L, self.kernel.matrix(A, self.U, theta).T, lower=1).T
        corner -= rows @ rows.T
        L = np.zeros((self.n + len(A),) * 2, order="F")
        L[: self.n, : self.n] = self.L
        L[self.n :, : self.n] = rows
        L[self.n :, self.n :] = cholesky(corner)
        return L

    def sample_path(self, rng: np.random.Generator, n_features: int = 1024) -> Callable[[FloatArray], FloatArray]:
        """Draw one function from the posterior.

        A prior draw by spectral features is corrected by the kernel to pass through the data (Wilson et
        al. 2020, "Efficiently sampling functions from Gaussian process posteriors"), which keeps the
        posterior exact at the observations whatever the number of features.

        Returns:
            A function from points (m, d) to values (m,), units of y.
        """
        theta = self.hyperparameters.theta
        features = self.kernel.sample_features(self.dim, theta, n_features, rng)
        feature_weights = rng.standard_normal(n_features)
        noise = np.exp(0.5 * self.hyperparameters.log_noise) * rng.standard_normal(self.n)
        if self.n:
            residual = self.z - features(self.U) @ feature_weights - noise
            update, _ = lapack.dpotrs(self.L, residual, lower=1)

        def path(A: FloatArray) -> FloatArray:
            values = features(A) @ feature_weights
            if self.n:
                values = values + self.kernel.matrix(A, self.U, theta) @ update
            return values * self.scale + self.centre

        return path

    def log_marginal_likelihood(self) -> float:
        """Log density of the standardized values under the model."""
        if self.n == 0:
            return 0.0
        log_determinant = 2.0 * float(np.sum(np.log(np.diag(self.L))))
        return float(-0.5 * (self.z @ self.weights + log_determinant + self.n * np.log(2.0 * np.pi)))


def log_marginal_likelihood_and_gradient(
    U: FloatArray, z: FloatArray, hyperparameters: Hyperparameters, kernel: Kernel = MATERN52
) -> tuple[float, FloatArray]:
    """Log density of standardized values z, shape (n,), and its gradient.

    Returns:
        (value, gradient with respect to ``hyperparameters.vector``, shape (p + 1,)).

    Raises:
        InvalidSettingsError: the covariance is not positive definite.
    """
    noise = float(np.exp(hyperparameters.log_noise))
    K = kernel.matrix(U, U, hyperparameters.theta)
    K.flat[:: len(K) + 1] += noise
    L = cholesky(K)
    weights, _ = lapack.dpotrs(L, z, lower=1)
    value = -0.5 * float(z @ weights) - float(np.sum(np.log(np.diag(L)))) - 0.5 * len(z) * np.log(2.0 * np.pi)
    inverse, _ = lapack.dpotri(L, lower=1, overwrite_c=1)
    W = inverse.T  # C order; LAPACK's lower triangle is its upper one
    pairwise.evidence_weights(W, weights)
    gradient = 0.5 * kernel.parameter_gradient(U, hyperparameters.theta, W)
    return value, np.append(gradient, 0.5 * noise * float(np.trace(W)))
