"""Local penalization of points that are being evaluated (González et al. 2016; thesis appendix D).

A pending point x_j with value f_j excludes, for an L-Lipschitz objective with maximum M, the ball of radius
(M - f_j) / L. The worth elsewhere is multiplied by the probability of lying outside of that ball,
phi(x; x_j) = ½ erfc(-z), z = (L ‖x - x_j‖ - M + mean_j) / sqrt(2 sd_j²).
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import PointFunction
from mebo_grasp.optimization.acquisition.maximizer import NumericGradient, climb
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.posterior import Posterior

FLAT = 1e-7
"""Below this slope of the standardized mean the surrogate says nothing about L (GPyOpt's limit)."""

FLAT_LIPSCHITZ = 10.0
"""L of standardized values assumed then (GPyOpt's value)."""

RESOLUTION = 0.3
"""Least uncertainty of a pending value, as a share of the values' standard deviation.

At a maximum that is known well, M - mean_j and sd_j both vanish, and with them the ball: the next point of
the batch would lie beside the first one for no gain in knowledge. (The thesis's implementation gave batches
of variance 0.0000 on Branin.) With this floor the next point goes to another place whose value is as good.
"""


def lipschitz_constant(posterior: Posterior, rng: np.random.Generator) -> float:
    """Greatest slope of the posterior mean in the unit cube, units of y per side.

    The gradient is exact. It is evaluated on a Sobol net and at the observations, and the three steepest
    places are climbed further.
    """
    points = np.concatenate([sobol(128 * posterior.dim, posterior.dim, rng), posterior.U])

    def slope(A: FloatArray) -> FloatArray:
        norm: FloatArray = np.linalg.norm(posterior.mean_gradient(A), axis=1)
        return norm

    values = slope(points)
    steepest = float(values.max())
    function = NumericGradient(slope)
    zero, one = np.zeros(posterior.dim), np.ones(posterior.dim)
    for start in points[np.argsort(-values, kind="stable")[:3]]:
        steepest = max(steepest, climb(function, start, zero, one, 20)[1])
    if steepest < FLAT * posterior.scale:
        return FLAT_LIPSCHITZ * posterior.scale
    return steepest


class LocalPenalizer:
    """Log probability of lying outside the balls of all pending points.

    Args:
        posterior: the surrogate.
        maximum: M, the best value observed, units of y.
        lipschitz: L, units of y per side of the cube.
    """

    def __init__(self, posterior: Posterior, maximum: float, lipschitz: float) -> None:
        self._posterior = posterior
        self._maximum = maximum
        self._lipschitz = lipschitz
        self._centres = np.empty((0, posterior.dim))
        self._means = np.empty(0)
        self._sds = np.empty(0)

    def add(self, points: FloatArray) -> None:
        """Penalize the surroundings of further points, shape (k, d)."""
        mean, sd = self._posterior.predict(points)
        self._centres = np.concatenate([self._centres, points])
        # A mean above the best value would give a negative radius: such a point excludes nothing but itself.
        self._means = np.append(self._means, np.minimum(mean, self._maximum))
        resolution = RESOLUTION * self._posterior.scale
        self._sds = np.append(self._sds, np.sqrt(sd**2 + self._posterior.noise_sd**2 + resolution**2))

    def __call__(self, A: FloatArray) -> FloatArray:
        """Log penalty at A, shape (m, d); 0 means none. Returns shape (m,)."""
        if len(self._centres) == 0:
            return np.zeros(len(A))
        distances = np.linalg.norm(A[:, None, :] - self._centres[None], axis=2)
        z = (self._lipschitz * distances - self._maximum + self._means) / self._sds
        # The penalty is a normal distribution function; its log stays finite where it underflows itself.
        penalty: FloatArray = log_ndtr(z).sum(axis=1)
        return penalty


def log_softplus(values: FloatArray) -> FloatArray:
    """Return log(log(1 + exp(v))), which makes any worth a positive factor, without over- or underflow."""
    soft = np.logaddexp(0.0, values)
    return np.where(values < -30.0, values, np.log(np.maximum(soft, 1e-300)))


def penalized(worth: PointFunction, penalizer: LocalPenalizer, centre: float, scale: float) -> NumericGradient:
    """Return log(softplus(worth) · penalty) as a worth.

    Args:
        worth: any worth in units of y, e.g. UCB.
        penalizer: of the points being evaluated.
        centre: subtracted from the worth, so that softplus bends where the values are.
        scale: divides the worth then.
    """

    def value(A: FloatArray) -> FloatArray:
        return log_softplus((worth(A) - centre) / scale) + penalizer(A)

    return NumericGradient(value)
