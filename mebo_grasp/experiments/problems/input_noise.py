"""Functions whose highest summit is no safe place to aim at, for optimization under input noise.

Source: Nogueira et al., "Unscented Bayesian optimization for safe robot grasping" and its longer version with treed
Gaussian processes, section V-A. All are maximized on the unit cube. The mixture lacks the factor 1/2 that
a two-dimensional normal density has and one of its covariances counts by its lower triangle: only so
do its values agree with the printed ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import multivariate_normal

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems.problem import Problem
from mebo_grasp.grasp import FloatArray

# RKHS: a coarse and a fine sum of bumps, (bandwidth, centres, weights) each.
_COARSE = (0.1, (0.1, 0.15, 0.08, 0.3, 0.4), (4.0, -1.0, 2.0, -2.0, 1.0))
_FINE = (
    0.01,
    (0.8, 0.85, 0.9, 0.95, 0.92, 0.74, 0.91, 0.89, 0.79, 0.88, 0.86, 0.96, 0.99, 0.82),
    (3.0, 4.0, 2.0, 1.0, -1.0, 2.0, 2.0, 3.0, 3.0, 2.0, -1.0, -2.0, 4.0, -3.0),
)

# Mixture: weight, mean, covariance of each component.
_COMPONENTS = (
    (0.2, (1.5, 0.0), ((1.0, 0.0), (0.0, 1.0))),
    (0.5, (3.0, 3.0), ((5.0, 0.0), (0.0, 1.0))),
    (0.5, (4.0, -1.0), ((2.0, 0.5), (0.5, 4.0))),
    (0.1, (0.0, -2.0), ((0.3, 0.0), (0.0, 0.3))),
    (0.5, (2.0, 2.0), ((10.0, 0.0), (0.0, 10.0))),
    (0.5, (2.0, -1.0), ((5.0, 0.0), (0.0, 5.0))),
)
_NORMALS = [(weight, multivariate_normal(mean, cov)) for weight, mean, cov in _COMPONENTS]
_MISSING_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class NoisyInputProblem:
    """A function with the noise of the inputs, and the sizes of the paper's runs.

    Args:
        problem: the function, on the unit cube; its optimum is the highest value, safe or not.
        noise_sd: standard deviation of each input, sides of the cube.
        safe_optimum: summit of the expected value under that noise, shape (d,).
        n_initial: points of the initial design.
        n_ubo: trials after it where input noise is studied; 0 where the paper does not.
        n_tgp: trials after it where the treed surrogate is studied.
        min_leaf: observations that a leaf of the tree has at least.
        signal_variance: signal variance of the paper's surrogate, squared units of y.
    """

    problem: Problem
    noise_sd: float
    safe_optimum: FloatArray
    n_initial: int
    n_ubo: int
    n_tgp: int
    min_leaf: int
    signal_variance: float


def rkhs(X: FloatArray) -> FloatArray:
    """A sum of Gaussian bumps, broad on the left and narrow on the right, points (n, 1) on [0, 1]."""
    total = np.zeros(len(X))
    for bandwidth, centres, weights in (_COARSE, _FINE):
        offsets = X[:, :1] - np.array(centres)
        total += np.exp(-(offsets**2) / (2.0 * bandwidth**2)) @ np.array(weights)
    return total


def gramacy(X: FloatArray) -> FloatArray:
    """Gramacy's exponential function, negated, points (n, 2): one hill and one hollow, flat elsewhere."""
    u = 8.0 * X - 2.0
    return np.asarray(-u[:, 0] * np.exp(-(u[:, 0] ** 2) - u[:, 1] ** 2))


def gaussian_mixture(X: FloatArray) -> FloatArray:
    """Six two-dimensional Gaussians, points (n, 2): a narrow summit, a lower and broader one, a third."""
    u = np.column_stack([7.0 * X[:, 0] - 1.0, 8.0 * X[:, 1] - 4.0])
    total = np.zeros(len(X))
    for weight, normal in _NORMALS:
        total += weight * np.atleast_1d(normal.pdf(u))
    return _MISSING_FACTOR * total


def _problem(name: str, dim: int, function: object, value: float, at: tuple[float, ...]) -> Problem:
    lower, upper = np.zeros(dim), np.ones(dim)
    return Problem(name, 0, dim, lower, upper, 1, value, 0.01, function, np.array([at]))  # type: ignore[arg-type]


def _rkhs() -> NoisyInputProblem:
    problem = _problem("rkhs", 1, rkhs, 5.73839, (0.892362,))
    return NoisyInputProblem(problem, 0.01, np.array([0.0775]), 5, 45, 45, 8, 3.93**2)


def _gramacy() -> NoisyInputProblem:
    summit = ((2.0 - np.sqrt(0.5)) / 8.0, 0.25)
    problem = _problem("gramacy", 2, gramacy, float(np.exp(-0.5) * np.sqrt(0.5)), summit)
    return NoisyInputProblem(problem, 0.1, np.array([0.108, 0.25]), 20, 0, 40, 15, 0.2**2)


def _mixture() -> NoisyInputProblem:
    problem = _problem("gaussian_mixture", 2, gaussian_mixture, 0.13566, (0.14926, 0.25443))
    return NoisyInputProblem(problem, 0.1, np.array([0.4445, 0.4827]), 30, 90, 110, 15, 0.642**2)


_PROBLEMS = {"rkhs": _rkhs, "gramacy": _gramacy, "gaussian_mixture": _mixture}

NOISY_INPUT_FUNCTIONS = tuple(_PROBLEMS)
"""Names that ``get_noisy_input_problem`` knows."""


def get_noisy_input_problem(name: str) -> NoisyInputProblem:
    """Build one of ``NOISY_INPUT_FUNCTIONS``.

    Raises:
        InvalidSettingsError: there is no such function.
    """
    if name not in _PROBLEMS:
        raise InvalidSettingsError(f"function must be one of {', '.join(NOISY_INPUT_FUNCTIONS)}, got {name!r}")
    return _PROBLEMS[name]()
