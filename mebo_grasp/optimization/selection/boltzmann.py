"""Boltzmann selection: the next query is drawn from exp(beta_t alpha) by Metropolis–Hastings (thesis 5.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import Acquisition
from mebo_grasp.optimization.acquisition.unscented import UnscentedTransform
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.posterior import Posterior

STEP_SDS = (0.3, 0.1, 0.01, 0.001)
"""Standard deviations of the Gaussian proposals, sides of the box; the fifth proposal is uniform."""

NET_SIZE = 256
"""Points of the Sobol net on which an acquisition is standardized and the chains are started."""


@dataclass(frozen=True)
class BoltzmannSettings:
    """How queries are drawn.

    Args:
        beta: inverse temperature beta_t on the standardized acquisition; the thesis gives no value.
        burn_in: proposals per dimension that are discarded before a query is taken (thesis 7.2: 250),
            over all chains that run side by side for that query.
        chains: chains side by side for one query; 1 gives the single long chain of the thesis.
        proportional: draw in proportion to the acquisition itself, shifted to be non-negative, as the
            thesis's code does, instead of exp(beta alpha).

    Raises:
        InvalidSettingsError: a number is out of its range.
    """

    beta: float = 3.0
    burn_in: int = 250
    chains: int = 16
    proportional: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.beta < float("inf"):
            raise InvalidSettingsError(f"boltzmann beta must be finite and at least 0, got {self.beta}")
        if self.burn_in < 1 or self.chains < 1:
            raise InvalidSettingsError(f"burn_in and chains must be at least 1, got {self.burn_in} and {self.chains}")


@dataclass(frozen=True, eq=False)
class Box:
    """The part of the unit cube in which queries are drawn.

    Args:
        lower, upper: corners, shape (d,).
    """

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def unit(cls, dim: int) -> Box:
        """The whole unit cube."""
        return cls(np.zeros(dim), np.ones(dim))


class LogTarget:
    """Unnormalized log density of the queries for one acquisition, standardized over a net.

    Args:
        net_values: the acquisition on the Sobol net, shape (n_net,).
        settings: beta and the form of the target.
    """

    def __init__(self, net_values: FloatArray, settings: BoltzmannSettings) -> None:
        self._mean = float(np.mean(net_values))
        # A flat acquisition (early plateaus) has no scale; dividing by 1 then leaves a uniform target.
        spread = float(np.std(net_values))
        self._scale = spread if spread > 0.0 else 1.0
        self._minimum = float(np.min(net_values))
        self._beta = settings.beta
        self._proportional = settings.proportional

    def __call__(self, values: FloatArray) -> FloatArray:
        """Log density, shape (m,), of points with acquisition ``values``, shape (m,)."""
        if self._proportional:
            with np.errstate(divide="ignore"):
                return np.log(np.maximum(values - min(self._minimum, 0.0), 0.0))
        return self._beta * (values - self._mean) / self._scale


def metropolis_hastings(
    log_density: Callable[[FloatArray], FloatArray],
    starts: FloatArray,
    n_steps: int,
    box: Box,
    rng: np.random.Generator,
) -> FloatArray:
    """Run one chain from each start, all side by side, and return where they end.

    A proposal is uniform over the box or a Gaussian step of one of ``STEP_SDS`` box sides, each with
    probability 1/5; all are symmetric, so the acceptance ratio is that of the densities. Proposals that
    leave the box are rejected.

    Args:
        log_density: function from points (m, d) to unnormalized log densities (m,).
        starts: shape (m, d), inside the box.
        n_steps: proposals a chain.
        box: where the density lives.
        rng: source of randomness.

    Returns:
        States after ``n_steps`` proposals, shape (m, d).
    """
    m, dim = starts.shape
    side = box.upper - box.lower
    states = starts.copy()
    current = log_density(states)
    sds = np.array((0.0, *STEP_SDS))[rng.integers(0, len(STEP_SDS) + 1, (n_steps, m))]
    log_uniforms = np.log(rng.random((n_steps, m)))
    for step in range(n_steps):
        sd = sds[step][:, None]
        walk = states + sd * side * rng.standard_normal((m, dim))
        proposals = np.where(sd == 0.0, box.lower + side * rng.random((m, dim)), walk)
        inside = np.all((proposals >= box.lower) & (proposals <= box.upper), axis=1)
        proposals = np.clip(proposals, box.lower, box.upper)
        proposed = log_density(proposals)
        with np.errstate(invalid="ignore"):
            # From a state of density zero (log -inf) the ratio has no meaning; every proposal is accepted.
            gain = np.where(np.isneginf(current), 0.0, proposed - current)
        accepted = inside & (log_uniforms[step] < gain)
        states = np.where(accepted[:, None], proposals, states)
        current = np.where(accepted, proposed, current)
    return states


class _Slots:
    """Densities of several acquisitions on one posterior: rows i·chains … belong to acquisition i."""

    def __init__(
        self,
        posterior: Posterior,
        acquisitions: Sequence[Acquisition],
        chains: int,
        transform: UnscentedTransform | None,
    ) -> None:
        self.transform = transform
        self.posterior = posterior
        self.acquisitions = acquisitions
        self.chains = chains
        self.targets: list[LogTarget] = []

    def __call__(self, points: FloatArray) -> FloatArray:
        values = self.values(points)
        log_density = np.empty(len(points))
        for i, (acquisition, target) in enumerate(zip(self.acquisitions, self.targets, strict=True)):
            rows = slice(i * self.chains, (i + 1) * self.chains)
            log_density[rows] = target(values(acquisition, rows))
        return log_density

    def values(self, points: FloatArray) -> Callable[[Acquisition, slice], FloatArray]:
        """Predict at all points at once; return what gives an acquisition's values at some of them.

        Under input noise these are its expectations over the sigma points.
        """
        transform = self.transform
        size, queries = (1, points) if transform is None else (transform.size, transform.points(points))
        mean, sd = self.posterior.predict(queries)

        def evaluate(acquisition: Acquisition, rows: slice) -> FloatArray:
            own = slice(rows.start * size, rows.stop * size)
            worth = acquisition.value_at(queries[own], mean[own], sd[own])
            return worth if transform is None else transform.mean(worth)

        return evaluate


def draw(
    posterior: Posterior,
    acquisitions: Sequence[Acquisition],
    rng: np.random.Generator,
    settings: BoltzmannSettings | None = None,
    per_acquisition: int = 1,
    box: Box | None = None,
    transform: UnscentedTransform | None = None,
) -> FloatArray:
    """Draw queries for several acquisitions on one posterior.

    For each acquisition, ``settings.chains`` chains (or as many as queries are wanted, if more) start on a
    Sobol net, resampled by the target, and run until ``burn_in * d`` proposals a query are discarded. The
    queries are the ends of randomly chosen chains. All chains of all acquisitions advance together, so a
    step is one call of the posterior.

    Args:
        posterior: the surrogate.
        acquisitions: one an independent slot, k of them.
        rng: source of randomness.
        settings: temperature, burn-in, chains.
        per_acquisition: queries wanted from each acquisition, T.
        box: where to draw; default the unit cube.
        transform: input noise, under which the acquisitions' expectations count; default none.

    Returns:
        Queries in the unit cube, shape (k, T, d).
    """
    settings = settings or BoltzmannSettings()
    dim = posterior.dim
    box = box or Box.unit(dim)
    chains = max(settings.chains, per_acquisition)
    slots = _Slots(posterior, acquisitions, chains, transform)
    net = box.lower + (box.upper - box.lower) * sobol(NET_SIZE, dim, rng)
    net_values = slots.values(net)
    starts = np.empty((len(acquisitions), chains, dim))
    for i, acquisition in enumerate(acquisitions):
        values = net_values(acquisition, slice(0, len(net)))
        target = LogTarget(values, settings)
        slots.targets.append(target)
        starts[i] = net[_resample(target(values), chains, rng)]
    n_steps = -(-settings.burn_in * dim // settings.chains)
    ends = metropolis_hastings(slots, starts.reshape(-1, dim), n_steps, box, rng)
    ends = ends.reshape(len(acquisitions), chains, dim)
    return np.stack([rows[rng.permutation(chains)[:per_acquisition]] for rows in ends])


def _resample(log_weights: FloatArray, count: int, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Indices, shape (count,), drawn in proportion to exp(log_weights); uniform if all vanish."""
    top = float(np.max(log_weights))
    weights = np.exp(log_weights - top) if np.isfinite(top) else np.ones_like(log_weights)
    return rng.choice(len(weights), count, p=weights / np.sum(weights))
