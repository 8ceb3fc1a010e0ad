"""Empirical Bayes: the most probable hyperparameters under log-normal priors, by L-BFGS-B."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import LEAST_NOISE, MOST_NOISE
from mebo_grasp.optimization.surrogate.bounded_bfgs import minimize_in_box
from mebo_grasp.optimization.surrogate.gaussian_process import (
    GaussianProcess,
    Hyperparameters,
    log_marginal_likelihood_and_gradient,
)
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior

NOISE_MEDIAN, NOISE_SD = 1e-5, 2.0


LogDensity = Callable[[FloatArray], tuple[float, FloatArray]]
"""Of hyperparameters, shape (p + 1,): the logarithm up to a constant and its gradient; may raise InvalidSettingsError
where a covariance is singular."""


def noise_prior(known: float | None = None) -> LogNormalPrior:
    """Prior of the noise variance of standardized values; of a known one, the value itself.

    The simulated trials are deterministic, so small noise is expected; 2 nats of spread still let a noise
    of a tenth of the signal's standard deviation pass at a cost of 6 nats, soon outweighed by the data.
    """
    prior = LogNormalPrior.repeated(1, NOISE_MEDIAN, NOISE_SD, LEAST_NOISE, MOST_NOISE)
    return prior if known is None else prior.with_known(0, float(np.log(known)))


@dataclass(frozen=True)
class LearningSettings:
    """How the hyperparameters are sought.

    Args:
        n_starts: starting points of the first learning: the prior's median, then draws from the prior.
        n_restarts: starting points besides the current hyperparameters in later learnings, chosen alike.
        max_iterations: of L-BFGS-B from each start.
        scout_points: above this number of observations the starting points are first climbed from on a
            subset, and only the best of where they end is climbed from on all observations.
        max_points: above this number a subset (the best tenth and a random rest) stands for all
            observations, which keeps the cost of learning constant as n grows.

    Raises:
        InvalidSettingsError: a number is below 1 (``n_restarts`` below 0).
    """

    n_starts: int = 3
    n_restarts: int = 1
    max_iterations: int = 40
    scout_points: int = 150
    max_points: int = 600

    def __post_init__(self) -> None:
        few = min(self.scout_points, self.max_points)
        if min(self.n_starts, self.max_iterations) < 1 or self.n_restarts < 0 or few < 2:
            raise InvalidSettingsError(
                f"need n_starts and max_iterations >= 1, n_restarts >= 0 and points >= 2, got {self}"
            )


def full_prior(dim: int, kernel: Kernel, noise: LogNormalPrior | None = None) -> LogNormalPrior:
    """Prior of the kernel's parameters and the noise variance (default ``noise_prior``), p + 1 entries."""
    return kernel.prior(dim) + (noise or noise_prior())


def log_posterior_and_gradient(
    vector: FloatArray, U: FloatArray, z: FloatArray, kernel: Kernel, prior: LogNormalPrior
) -> tuple[float, FloatArray]:
    """Log posterior density of (theta, log noise), shape (p + 1,), up to a constant, and its gradient."""
    value, gradient = log_marginal_likelihood_and_gradient(U, z, Hyperparameters.from_vector(vector), kernel)
    log_prior, prior_gradient = prior.log_density_and_gradient(vector)
    return value + log_prior, gradient + prior_gradient


def log_posterior(vector: FloatArray, U: FloatArray, z: FloatArray, kernel: Kernel, prior: LogNormalPrior) -> float:
    """Log posterior density of (theta, log noise), shape (p + 1,), up to a constant."""
    posterior = GaussianProcess.of_standardized(U, z, Hyperparameters.from_vector(vector), kernel)
    return posterior.log_marginal_likelihood() + prior.log_density_and_gradient(vector)[0]


def subset(z: FloatArray, max_points: int, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Mask of the points used for learning, shape (n,)."""
    mask = np.ones(len(z), dtype=bool)
    if len(z) <= max_points:
        return mask
    order = np.argsort(-z, kind="stable")
    n_best = max_points // 10
    mask[:] = False
    mask[order[:n_best]] = True
    mask[rng.choice(order[n_best:], max_points - n_best, replace=False)] = True
    return mask


def learn(
    U: FloatArray,
    z: FloatArray,
    kernel: Kernel = MATERN52,
    current: Hyperparameters | None = None,
    rng: np.random.Generator | None = None,
    settings: LearningSettings | None = None,
    noise: LogNormalPrior | None = None,
) -> tuple[Hyperparameters, float]:
    """Return the most probable hyperparameters found and their log posterior density.

    Args:
        U: points in the unit cube, shape (n, d).
        z: standardized values, shape (n,).
        kernel: covariance function.
        current: where the first search starts, if known.
        rng: draws the further starting points and the subset.
        settings: how to search.
        noise: prior of the noise variance; default ``noise_prior``.
    """
    settings = settings or LearningSettings()
    rng = rng or np.random.default_rng(0)
    prior = full_prior(U.shape[1], kernel, noise)
    mask = subset(z, settings.max_points, rng)
    U, z = np.ascontiguousarray(U[mask]), z[mask]
    starts = _starts(prior, current, rng, settings)
    if len(z) > settings.scout_points:
        starts = [_scouted(starts, current is not None, U, z, kernel, prior, rng, settings)]
    ends = [climb_posterior(start, U, z, kernel, prior, settings.max_iterations) for start in starts]
    best_vector, best_value = max(ends, key=lambda end: end[1])
    return Hyperparameters.from_vector(best_vector), best_value


def _scouted(
    starts: list[FloatArray],
    first_is_known: bool,
    U: FloatArray,
    z: FloatArray,
    kernel: Kernel,
    prior: LogNormalPrior,
    rng: np.random.Generator,
    settings: LearningSettings,
) -> FloatArray:
    """Climb from the starts on a subset; return the best end, or known start, on all observations."""
    mask = subset(z, settings.scout_points, rng)
    few_U, few_z = np.ascontiguousarray(U[mask]), z[mask]
    fresh = starts[1:] if first_is_known else starts
    ends = [climb_posterior(start, few_U, few_z, kernel, prior, settings.max_iterations)[0] for start in fresh]
    candidates = [*starts[:1], *ends] if first_is_known else ends
    return max(candidates, key=lambda vector: height(vector, U, z, kernel, prior))


def height(vector: FloatArray, U: FloatArray, z: FloatArray, kernel: Kernel, prior: LogNormalPrior) -> float:
    """``log_posterior``, or -inf where the covariance is numerically singular."""
    try:
        return log_posterior(vector, U, z, kernel, prior)
    except InvalidSettingsError:
        return -np.inf


def _starts(
    prior: LogNormalPrior,
    current: Hyperparameters | None,
    rng: np.random.Generator,
    settings: LearningSettings,
) -> list[FloatArray]:
    starts = [] if current is None else [current.vector]
    fresh = settings.n_starts if current is None else settings.n_restarts
    if fresh:
        starts.append(prior.mean)
    starts.extend(prior.mean + prior.sd * rng.standard_normal((max(0, fresh - 1), len(prior.mean))))
    return [np.clip(start, prior.lower, prior.upper) for start in starts]


def climb(
    density: LogDensity, prior: LogNormalPrior, start: FloatArray, max_iterations: int
) -> tuple[FloatArray, float]:
    """Climb a log density by L-BFGS-B within the prior's box; return where it ends and its value there.

    Args:
        density: what to climb.
        prior: tells the box.
        start: where to begin, shape (p + 1,); clipped to the box.
        max_iterations: of L-BFGS-B.
    """
    result = minimize(
        _loss(density), np.clip(start, prior.lower, prior.upper), jac=True, method="L-BFGS-B",
        bounds=list(zip(prior.lower, prior.upper, strict=True)),
        options={"maxiter": max_iterations, "ftol": 1e-6, "gtol": 1e-3},
    )  # fmt: skip
    return np.asarray(result.x, dtype=np.float64), -float(result.fun)


def climb_coupled(
    density: LogDensity, prior: LogNormalPrior, start: FloatArray, max_iterations: int
) -> tuple[FloatArray, float]:
    """Like ``climb``, by a full BFGS in units of the prior's standard deviations: for strongly coupled parameters."""
    loss = _loss(density)

    def scaled(t: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = loss(t * prior.sd)
        return value, gradient * prior.sd

    end, lowest = minimize_in_box(
        scaled, start / prior.sd, prior.lower / prior.sd, prior.upper / prior.sd, max_iterations
    )
    return np.clip(end * prior.sd, prior.lower, prior.upper), -lowest


def _loss(density: LogDensity) -> LogDensity:
    """The negative; where the covariance is numerically singular it is so high that a line search backs off."""

    def loss(vector: FloatArray) -> tuple[float, FloatArray]:
        try:
            value, gradient = density(vector)
        except InvalidSettingsError:
            return 1e25, np.zeros_like(vector)
        return -value, -gradient

    return loss


def climb_posterior(
    start: FloatArray,
    U: FloatArray,
    z: FloatArray,
    kernel: Kernel,
    prior: LogNormalPrior,
    max_iterations: int,
) -> tuple[FloatArray, float]:
    """Climb the log posterior density of (theta, log noise); see ``climb``."""
    return climb(lambda vector: log_posterior_and_gradient(vector, U, z, kernel, prior), prior, start, max_iterations)
