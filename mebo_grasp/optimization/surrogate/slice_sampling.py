"""Hyperparameters by Markov chain Monte Carlo: univariate slice sampling with stepping out (Neal 2003)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters
from mebo_grasp.optimization.surrogate.hyperparameters import full_prior, subset
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior

MAX_STEPS_OUT = 8
"""Widenings of an interval to each side; the prior keeps the density narrow."""

LogDensity = Callable[[FloatArray], float]


@dataclass(frozen=True)
class SamplingSettings:
    """How the hyperparameters are drawn.

    Args:
        n_samples: draws kept (thesis's library: 10).
        burn_in: sweeps over all parameters before the first draw of a run.
        warm_burn_in: sweeps before the first draw when the chain continues from earlier draws.
        width: first interval on each log parameter.
        max_points: above this number of observations a subset is used.

    Raises:
        InvalidSettingsError: a number is out of its range.
    """

    n_samples: int = 10
    burn_in: int = 30
    warm_burn_in: int = 3
    width: float = 1.5
    max_points: int = 400

    def __post_init__(self) -> None:
        if self.n_samples < 1 or min(self.burn_in, self.warm_burn_in) < 0 or self.max_points < 2:
            raise InvalidSettingsError(f"need n_samples >= 1, burn-ins >= 0 and max_points >= 2, got {self}")
        if not 0.0 < self.width < float("inf"):
            raise InvalidSettingsError(f"the width must be finite and above 0, got {self.width}")


def slice_sweep(
    log_density: LogDensity,
    state: FloatArray,
    value: float,
    width: float,
    rng: np.random.Generator,
    coordinates: npt.NDArray[np.int64] | None = None,
) -> tuple[FloatArray, float]:
    """Update each coordinate once, in random order.

    Args:
        log_density: of a vector, shape (p,), up to a constant.
        state: shape (p,).
        value: log density there.
        width: first interval.
        rng: source of randomness.
        coordinates: those to be updated; all if None.

    Returns:
        (new state, its log density).
    """
    for i in rng.permutation(np.arange(len(state)) if coordinates is None else coordinates):
        state, value = _slice_coordinate(log_density, state, value, int(i), width, rng)
    return state, value


def _slice_coordinate(
    log_density: LogDensity,
    state: FloatArray,
    value: float,
    i: int,
    width: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    def along(position: float) -> float:
        moved = state.copy()
        moved[i] = position
        return log_density(moved)

    level = value + np.log(rng.random())
    left = state[i] - width * rng.random()
    right = left + width
    steps_left = int(rng.integers(0, MAX_STEPS_OUT + 1))
    steps_right = MAX_STEPS_OUT - steps_left
    while steps_left > 0 and along(left) > level:
        left, steps_left = left - width, steps_left - 1
    while steps_right > 0 and along(right) > level:
        right, steps_right = right + width, steps_right - 1
    while True:
        position = left + (right - left) * rng.random()
        proposed = along(position)
        if proposed > level:
            moved = state.copy()
            moved[i] = position
            return moved, proposed
        # Shrink towards the present state, which is always inside of the slice.
        if position < state[i]:
            left = position
        else:
            right = position
        if right - left < 1e-10:
            return state, value


def sample_hyperparameters(
    U: FloatArray,
    z: FloatArray,
    rng: np.random.Generator,
    kernel: Kernel = MATERN52,
    current: Hyperparameters | None = None,
    settings: SamplingSettings | None = None,
    noise: LogNormalPrior | None = None,
) -> list[Hyperparameters]:
    """Draw from the posterior of the hyperparameters, log-normal priors included.

    Args:
        U: points in the unit cube, shape (n, d).
        z: standardized values, shape (n,).
        rng: source of randomness.
        kernel: covariance function.
        current: last draw of an earlier chain, to go on from.
        settings: how many draws, how much burn-in.
        noise: prior of the noise variance; default ``noise_prior``.
    """
    settings = settings or SamplingSettings()
    prior = full_prior(U.shape[1], kernel, noise)
    mask = subset(z, settings.max_points, rng)
    U, z = np.ascontiguousarray(U[mask]), z[mask]

    def log_density(vector: FloatArray) -> float:
        if np.any(vector < prior.lower) or np.any(vector > prior.upper):
            return -np.inf
        log_prior, _ = prior.log_density_and_gradient(vector)
        try:
            fitted = GaussianProcess.of_standardized(U, z, Hyperparameters.from_vector(vector), kernel)
        except InvalidSettingsError:
            return -np.inf
        return fitted.log_marginal_likelihood() + log_prior

    start = np.clip(prior.mean if current is None else current.vector, prior.lower, prior.upper)
    return sample_chain(log_density, start, prior.unknown, current is not None, rng, settings)


def sample_chain(
    log_density: LogDensity,
    state: FloatArray,
    unknown: npt.NDArray[np.int64],
    warm: bool,
    rng: np.random.Generator,
    settings: SamplingSettings,
) -> list[Hyperparameters]:
    """Draw hyperparameters from a density, one a sweep after the burn-in.

    Args:
        log_density: of (theta, log noise), shape (p + 1,), up to a constant.
        state: where the chain starts, shape (p + 1,).
        unknown: indices of the parameters to be drawn; the others stay.
        warm: whether the start is a draw of an earlier chain, so that a short burn-in does.
        rng: source of randomness.
        settings: how many draws, how much burn-in.
    """
    value = log_density(state)
    for _ in range(settings.warm_burn_in if warm else settings.burn_in):
        state, value = slice_sweep(log_density, state, value, settings.width, rng, unknown)
    draws = []
    for _ in range(settings.n_samples):
        state, value = slice_sweep(log_density, state, value, settings.width, rng, unknown)
        draws.append(Hyperparameters.from_vector(state))
    return draws
