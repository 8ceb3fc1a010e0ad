"""Basin search, the default method: one trial confirms a basin, the next goes elsewhere.

The surrogate's structure is chosen by evidence. Candidates are the local maxima of the optimistic posterior
(mean plus standard deviation) and of the mean. Each has a local incumbent, the best observation in the same
basin. A candidate's score is the expected improvement on its own incumbent times the probability that it
reaches the level of the best. A basin that has been confirmed has little left to improve, so the search
turns to the others by itself, and when all are confirmed it refines them. Every other trial of that last
stage goes instead to where an unconfirmed basin of the top level is least improbable, because a surrogate
that is too sure of itself would never look there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp

from mebo_grasp.errors import RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import (
    LogExpectedImprovement,
    log_normalized_improvement,
)
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.methods.base import IndexArray, MethodSettings, state_int
from mebo_grasp.optimization.methods.common import MethodBase, check_count, without_repeats
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection import basins
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.structure import Mixture, StructuredSurrogate

NET_SIZE, NET_SIZE_ABOVE_2D = 2048, 1024
LEVEL_NET_SIZE = 512
MAX_CANDIDATES, MAX_CANDIDATES_ABOVE_2D = 128, 32
"""Above two dimensions no net resolves all basins, and more points cost more than they find."""
TOP_SHARE = 0.05
"""A basin reaches the top if it comes within this share of the spread (best minus median) of the best."""
NEIGHBOURS = 8
SLACK_SHARE = 1e-3
RESOLUTION_SHARE = 1e-6
"""Improvements below this share of the spread are not worth a trial."""
SAME_PLACE = 1e-3
"""A pick this near to an observation, in every coordinate of the cube, does not open a new basin."""


@dataclass(frozen=True, eq=False)
class Level:
    """What counts as good, units of y.

    Args:
        best: highest value.
        spread: best minus the median over the search space.
    """

    best: float
    spread: float

    @property
    def top(self) -> float:
        """The level that a basin should reach."""
        return self.best - TOP_SHARE * self.spread

    @property
    def slack(self) -> float:
        """Dip that is forgiven within a basin."""
        return SLACK_SHARE * self.spread

    @property
    def resolution(self) -> float:
        """Improvement that is too small to matter."""
        return RESOLUTION_SHARE * self.spread


def level_of(posterior: GaussianProcess) -> Level:
    """The level of a posterior.

    The median is that of the mean over an even net, not of the observations: those gather at the top.
    """
    net = sobol(LEVEL_NET_SIZE, posterior.dim, np.random.default_rng(0))
    best = float(np.max(posterior.y))
    spread = best - float(np.median(posterior.predict_mean(net)))
    return Level(best, spread if spread > 0.0 else 1.0)


@dataclass(frozen=True, eq=False)
class View:
    """What one member of the mixture believes of m candidates.

    Args:
        posterior: the member.
        level: what counts as good for it.
        mean: shape (m,), units of y.
        sd: shape (m,).
        own: value of each candidate's local incumbent, shape (m,).
    """

    posterior: GaussianProcess
    level: Level
    mean: FloatArray
    sd: FloatArray
    own: FloatArray

    @property
    def log_scores(self) -> FloatArray:
        """Log of (expected improvement on the own incumbent × probability to reach the top), shape (m,)."""
        gain = self.mean - self.own - self.level.resolution
        improvement = np.log(self.sd) + log_normalized_improvement(gain / self.sd)
        value: FloatArray = improvement + log_ndtr(self.margins)
        return value

    @property
    def margins(self) -> FloatArray:
        """Standard deviations by which the mean exceeds the top level, shape (m,)."""
        return (self.mean - self.level.top) / self.sd

    @property
    def confirmed(self) -> npt.NDArray[np.bool_]:
        """Whether the incumbent has reached the top level and about what its basin promises, shape (m,)."""
        promised = self.mean - TOP_SHARE * self.level.spread
        return self.own >= np.maximum(self.level.top, promised)


class BasinSearch(MethodBase):
    """Multisolution search by basins with local incumbents.

    Args:
        space: the search space.
        settings: settings of the run.
    """

    name = "basin_search"

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self.surrogate = StructuredSurrogate(space.dim, settings.relearn_period)
        self._refinements = 0

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the next points, shape (count, d)."""
        check_count(count)
        if observations.n == 0:
            self._phase = "no data"
            return rng.random((count, observations.dim))
        mixture = self.surrogate.update(observations.U, observations.y, rng)
        assumed = np.concatenate([observations.failed, observations.pending])
        if len(assumed):
            mixture = mixture.condition_on(assumed)
        points = self._select(mixture, count, rng)
        return without_repeats(points, observations, rng)

    def _select(self, mixture: Mixture, count: int, rng: np.random.Generator) -> FloatArray:
        levels = [level_of(posterior) for posterior in mixture.posteriors]
        candidates = np.concatenate(
            [
                find_candidates(posterior, level, rng)
                for posterior, level in zip(mixture.posteriors, levels, strict=True)
            ]
        )
        picks: list[FloatArray] = []
        for _ in range(count):
            views = [
                view_of(posterior, candidates, level)
                for posterior, level in zip(mixture.posteriors, levels, strict=True)
            ]
            point, phase = pick(mixture, views, candidates, self._refinements % 2 == 1)
            self._refinements += phase != "search"
            self._phase = phase
            picks.append(point)
            mixture = mixture.condition_on(point[None])
        return np.stack(picks)

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """Best observation of each basin, best first; at ``min_distance`` from each other if given."""
        size = size if size is not None else self.settings.num_solutions
        distance = min_distance if min_distance is not None else self.settings.min_distance
        if observations.n == 0:
            return np.empty(0, dtype=np.int64)
        if distance is not None:
            return super().solution_set(observations, size, distance)
        posterior = self.surrogate.posterior(observations.U, observations.y)
        level = level_of(posterior)
        floor = level.best - 0.5 * level.spread
        return basins.representatives(
            posterior, observations.U, observations.y, 10 * level.slack, size, floor
        )

    def state(self) -> dict[str, Any]:
        """Phase and the surrogate's state."""
        return {
            **super().state(),
            "refinements": self._refinements,
            "surrogate": self.surrogate.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self._refinements = state_int(state, "refinements")
        surrogate = state.get("surrogate")
        if not isinstance(surrogate, dict):
            raise RunLogError(f"the method's state needs the surrogate's, got {surrogate!r}")
        self.surrogate.restore(surrogate)


def find_candidates(posterior: GaussianProcess, level: Level, rng: np.random.Generator) -> FloatArray:
    """Local maxima of mean plus standard deviation, of the mean, and of the margin, shape (m, d)."""
    coordinates = basins.Coordinates(posterior)
    planar = posterior.dim <= 2
    size = NET_SIZE if planar else NET_SIZE_ABOVE_2D
    limit = MAX_CANDIDATES if planar else MAX_CANDIDATES_ABOVE_2D
    net = np.concatenate([basins.search_net(posterior, size, rng), posterior.U])
    where = coordinates(net)
    mean, sd = posterior.predict(net)
    neighbours = 2 * posterior.dim + 2
    hopeful = basins.neighbourhood_maxima(mean + sd, where, neighbours)[:limit]
    peaks = basins.neighbourhood_maxima(mean, where, neighbours)[:limit]
    improbable = basins.neighbourhood_maxima((mean - level.top) / sd, where, neighbours)[:limit]
    scales = np.minimum(np.ptp(net, axis=0) / np.maximum(np.ptp(where, axis=0), 1e-9), 1.0)
    points = np.concatenate(
        [
            basins.ascend(optimistic(posterior), net[hopeful], scales, 10),
            basins.ascend(expected(posterior), net[peaks], scales, 16),
            net[improbable],
        ]
    )
    mean, sd = posterior.predict(points)
    return points[basins.distinct(mean + sd, coordinates(points), basins.SAME_MAXIMUM)]


def view_of(posterior: GaussianProcess, candidates: FloatArray, level: Level) -> View:
    """Look at candidates, shape (m, d)."""
    mean, sd = posterior.predict(candidates)
    return View(posterior, level, mean, sd, local_incumbents(posterior, candidates, level))


def pick(
    mixture: Mixture, views: list[View], candidates: FloatArray, explore: bool
) -> tuple[FloatArray, str]:
    """The candidate with the highest expected score, refined, shape (d,), and why it is taken.

    Args:
        mixture: what is believed.
        views: one a member.
        candidates: shape (m, d).
        explore: whether to look for the least improbable new basin if the best candidate's is confirmed.
    """
    # All members fit the same values, so their scores have the same units and may be averaged.
    value = np.stack([view.log_scores for view in views]) + np.log(mixture.shares)[:, None]
    best = int(np.argmax(logsumexp(value, axis=0)))
    # The member that expects most of this candidate places the point.
    view = views[int(np.argmax(value[:, best]))]
    point = refine(view.posterior, candidates[best], float(view.own[best]), view.level)
    known = np.any(np.all(np.abs(view.posterior.U - point) <= SAME_PLACE, axis=1))
    if not view.confirmed[best] and not known:
        return point, "search"
    refined = value[:, best].max() <= np.log(view.level.resolution)
    if explore or refined:
        margins = np.max([np.where(view.confirmed, -np.inf, view.margins) for view in views], axis=0)
        if np.any(np.isfinite(margins)):
            return candidates[int(np.argmax(margins))], "exploration"
    return point, "refinement"


def local_incumbents(posterior: GaussianProcess, candidates: FloatArray, level: Level) -> FloatArray:
    """Best value observed in each candidate's basin, shape (m,); the lowest of all where there is none."""
    y = posterior.y
    near = basins.basin_neighbours(posterior, candidates, posterior.U, NEIGHBOURS, level.slack)
    own = np.max(np.where(near.shared, y[near.index], -np.inf), axis=1)
    return np.where(np.isfinite(own), own, np.min(y))


def optimistic(posterior: GaussianProcess) -> basins.ValueAndGradient:
    """Mean plus standard deviation, with its gradient."""

    def function(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean, sd, d_mean, d_sd = posterior.predict_with_gradients(points)
        return mean + sd, d_mean + d_sd

    return function


def expected(posterior: GaussianProcess) -> basins.ValueAndGradient:
    """Mean, with its gradient."""

    def function(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return posterior.predict_mean(points), posterior.mean_gradient(points)

    return function


def refine(posterior: GaussianProcess, start: FloatArray, own: float, level: Level) -> FloatArray:
    """Climb the score from ``start``, shape (d,), with its incumbent kept; return the end, shape (d,)."""
    improvement = LogExpectedImprovement(own)

    def objective(u: FloatArray) -> tuple[float, FloatArray]:
        mean, sd, d_mean, d_sd = posterior.predict_with_gradients(u[None])
        by_mean, by_sd = improvement.partials(mean, sd)
        t = (mean - level.top) / sd
        value = improvement.value(mean, sd) + log_ndtr(t)
        mills = np.exp(-0.5 * t * t - 0.5 * np.log(2.0 * np.pi) - log_ndtr(t)) / sd
        gradient = (by_mean + mills)[:, None] * d_mean + (by_sd - t * mills)[:, None] * d_sd
        return -float(value[0]), -gradient[0]

    result = minimize(
        objective, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start),
        options={"maxiter": 30},
    )
    before = objective(start)[0]
    point: FloatArray = np.clip(result.x, 0.0, 1.0) if result.fun < before else start
    return point
