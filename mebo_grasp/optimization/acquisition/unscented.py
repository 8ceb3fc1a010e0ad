"""The unscented transform, and what it makes of acquisition functions and of the incumbent (UBO paper, section IV).

A query x that is carried out with noise of covariance S is stood for by 2 d + 1 sigma points, x and
x ± sqrt((d + k) S) by columns, with weights k / (d + k) and 1 / (2 (d + k)) (eq. 10 and 11). Mean and covariance of
what a function makes of the query are the weighted moments of its values there (eq. 12). They are exact
for polynomials of second (mean) and first (covariance) degree.

Beside a cliff, where the sigma points stand for little, ``of_draws`` makes the same of quasi-random draws of the noise.

A sigma point that would leave the cube is clipped to it: nothing is known outside, so the surrogate's answer there
would be its prior, and a summit at a bound would look worse than it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp, ndtri

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import PointFunction
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.search_space import SearchSpace


@dataclass(frozen=True, eq=False)
class UnscentedTransform:
    """Sigma points of a query. Build it with ``of_covariance`` or ``of_noise``, or of draws with ``of_draws``.

    Args:
        shifts: of the s = 2 d + 1 sigma points, the first of which is 0, or of the draws; shape (s, d), sides of the
            cube.
        weights: shape (s,), sum 1; the first is negative where k is.
    """

    shifts: FloatArray
    weights: FloatArray

    @classmethod
    def of_covariance(cls, covariance: npt.ArrayLike, kappa: float | None = None) -> UnscentedTransform:
        """Transform of noise with a covariance, shape (d, d), in sides of the unit cube.

        Args:
            covariance: symmetric, not negative; directions without noise are allowed.
            kappa: k; None for 1 in one and two dimensions and 0 in more.

        Raises:
            InvalidSettingsError: d + k is not above 0.
        """
        matrix = np.asarray(covariance, dtype=np.float64)
        dim = len(matrix)
        k = float(np.clip(3.0 - dim, 0.0, 1.0)) if kappa is None else kappa
        if not dim + k > 0.0:
            raise InvalidSettingsError(f"kappa must be above -{dim} in {dim} dimensions, got {k}")
        # The symmetric root exists where Cholesky's does not: for directions without noise.
        values, vectors = np.linalg.eigh(matrix)
        root = (vectors * np.sqrt(np.maximum(values, 0.0) * (dim + k))) @ vectors.T
        shifts = np.concatenate([np.zeros((1, dim)), root.T, -root.T])
        weights = np.full(2 * dim + 1, 0.5 / (dim + k))
        weights[0] = k / (dim + k)
        return cls(shifts, weights)

    @classmethod
    def of_noise(cls, noise: InputNoise, space: SearchSpace) -> UnscentedTransform:
        """Transform of the noise of queries in a space.

        Raises:
            InvalidSettingsError: the noise does not fit the space.
        """
        return cls.of_covariance(noise.in_cube(space), noise.kappa)

    @classmethod
    def of_draws(cls, covariance: npt.ArrayLike, pairs: int) -> UnscentedTransform:
        """Quasi-random draws of noise with a covariance, shape (d, d), always the same ones, each with its opposite.

        Args:
            covariance: symmetric, not negative, in sides of the unit cube.
            pairs: how many draws, their opposites not counted.
        """
        matrix = np.asarray(covariance, dtype=np.float64)
        values, vectors = np.linalg.eigh(matrix)
        net = sobol(pairs, len(matrix), np.random.default_rng(0))
        half = ndtri(np.clip(net, 1e-6, 1.0 - 1e-6)) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        return cls(np.concatenate([half, -half]), np.full(2 * pairs, 0.5 / pairs))

    @property
    def size(self) -> int:
        """Number of sigma points, 2 d + 1, or of draws."""
        return len(self.shifts)

    def points(self, A: FloatArray) -> FloatArray:
        """Sigma points of A, shape (m, d), clipped to the cube: shape (m (2 d + 1), d), those of a point in a row."""
        moved = A[:, None, :] + self.shifts[None]
        return np.clip(moved, 0.0, 1.0).reshape(-1, A.shape[1])

    def mean(self, values: FloatArray) -> FloatArray:
        """Means, shape (m,), of values at the sigma points, shape (m (2 d + 1),)."""
        mean: FloatArray = values.reshape(-1, self.size) @ self.weights
        return mean

    def moments(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means and standard deviations, shape (m,) each, of values at the sigma points, shape (m (2 d + 1),)."""
        rows = values.reshape(-1, self.size)
        mean = rows @ self.weights
        variance = ((rows - mean[:, None]) ** 2) @ self.weights
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def pulled_back(self, A: FloatArray, gradients: FloatArray) -> FloatArray:
        """Gradients by A, shape (m, 2 d + 1, d), of values whose gradients by their sigma points are given.

        A clipped coordinate of a sigma point stays where it is when A moves.
        """
        moved = A[:, None, :] + self.shifts[None]
        free = (moved >= 0.0) & (moved <= 1.0)
        return np.where(free, gradients.reshape(moved.shape), 0.0)


class Unscented:
    """Expected worth of a query under input noise: any worth of points, averaged over the sigma points (eq. 13).

    Args:
        function: the worth.
        transform: the noise.
    """

    def __init__(self, function: PointFunction, transform: UnscentedTransform) -> None:
        self._function = function
        self._transform = transform

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""
        return self._transform.mean(self._function(self._transform.points(A)))

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d)."""
        values, gradients = self._function.with_gradient(self._transform.points(A))
        slopes = self._transform.pulled_back(A, gradients)
        return self._transform.mean(values), np.einsum("s,msd->md", self._transform.weights, slopes)


class LogUnscented:
    """The same of a worth whose logarithm is given: log of the mean of exp(function), stable where exp underflows.

    Where a negative weight makes the mean negative, the logarithm is minus infinity.

    Args:
        function: logarithm of a positive worth.
        transform: the noise.
    """

    def __init__(self, function: PointFunction, transform: UnscentedTransform) -> None:
        self._function = function
        self._transform = transform

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""
        return self._combined(self._function(self._transform.points(A)))

    def _combined(self, values: FloatArray) -> FloatArray:
        rows = values.reshape(-1, self._transform.size)
        total, sign = logsumexp(rows, axis=1, b=self._transform.weights, return_sign=True)
        return np.where(sign > 0.0, total, -np.inf)

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d); 0 where the value is minus infinity."""
        values, gradients = self._function.with_gradient(self._transform.points(A))
        slopes = self._transform.pulled_back(A, gradients)
        total = self._combined(values)
        finite = np.isfinite(total)
        rows = values.reshape(-1, self._transform.size)
        shares = np.where(finite[:, None], np.exp(rows - np.where(finite, total, 0.0)[:, None]), 0.0)
        # A sigma point that is worth nothing has an undefined slope, and no share.
        slopes = np.where(shares[..., None] > 0.0, slopes, 0.0)
        return total, np.einsum("ms,msd->md", shares * self._transform.weights, slopes)


def unscented_outcomes(
    predict_mean: Callable[[FloatArray], FloatArray], A: FloatArray, transform: UnscentedTransform
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What to expect of queries under input noise, by a surrogate's mean at the sigma points (eq. 14).

    Args:
        predict_mean: points (m, d) to means (m,); averaged over hyperparameters where they are sampled.
        A: queries, shape (n, d), unit cube.
        transform: the noise.

    Returns:
        (expected value, standard deviation, worst of the sigma points), shape (n,) each.
    """
    values = predict_mean(transform.points(A)) if len(A) else np.empty(0)
    mean, sd = transform.moments(values)
    worst: FloatArray = values.reshape(-1, transform.size).min(axis=1) if len(A) else np.empty(0)
    return mean, sd, worst
