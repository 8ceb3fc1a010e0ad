"""What a belief makes of a few candidates: levels, local incumbents, and what a trial of each is worth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import log_ndtr

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import (
    LogExpectedImprovement,
    LogProbabilityOfImprovement,
    log_normalized_improvement,
)
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.selection import basins
from mebo_grasp.optimization.selection.basins import NO_INCUMBENT
from mebo_grasp.optimization.surrogate.belief import Belief

NET_SIZE, NET_SIZE_ABOVE_2D = 2048, 1024
SMALLEST_NET = 256
NET_WORK = 1_000_000
"""Covariances of the net with the observations that may be computed for one look. With more the net is halved, and
with it the number of candidates: the observations, which are looked at as well, stand for it."""
LEVEL_NET_SIZE = 512
MAX_CANDIDATES, MAX_CANDIDATES_ABOVE_2D = 128, 32
"""Above two dimensions no net resolves all basins, and more points cost more than they find."""
TOP_SHARE = 0.05
"""A basin reaches the top if it comes within this share of the spread (best minus median) of the best."""
NEIGHBOURS = 8
SLACK_SHARE = 1e-3
REFINED = 1e-5
"""A climb ends when a step gains less than this, relative, in the logarithm of what a trial is worth."""
RESOLUTION_SHARE = 1e-6
"""Improvements below this share of the spread are not worth a trial."""


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


def level_of(belief: Belief) -> Level:
    """The level of a belief.

    The median is that of the mean over an even net, not of the observations: those gather at the top.
    """
    net = sobol(LEVEL_NET_SIZE, belief.dim, np.random.default_rng(0))
    best = float(np.max(belief.y))
    spread = best - float(np.median(belief.predict_mean(net)))
    return Level(best, spread if spread > 0.0 else 1.0)


@dataclass(frozen=True, eq=False)
class View:
    """What one member of the beliefs believes of m candidates.

    Args:
        belief: the member.
        candidates: shape (m, d).
        level: what counts as good for it.
        mean: shape (m,), units of y.
        sd: shape (m,).
        log_chance: log probability to be off the plateau, shape (m,).
        own: value of each candidate's local incumbent, shape (m,).
        index: which of the belief's points the incumbent is, shape (m,); ``NO_INCUMBENT`` if there is none.
        reach: how far the observations that were asked for it lie, shape (m, 2); see ``basins.LocalIncumbents``.
        gap: how far the nearest observation lies in the kernel's coordinates, shape (m,).
    """

    belief: Belief
    candidates: FloatArray
    level: Level
    mean: FloatArray
    sd: FloatArray
    log_chance: FloatArray
    own: FloatArray
    index: npt.NDArray[np.int64]
    reach: FloatArray
    gap: FloatArray

    @property
    def log_scores(self) -> FloatArray:
        """Log of (expected improvement on the own incumbent × probability to reach the top), shape (m,)."""
        gain = self.mean - self.own - self.level.resolution
        improvement = np.log(self.sd) + log_normalized_improvement(gain / self.sd)
        value: FloatArray = improvement + self.log_chance + self.log_reach
        return value

    def log_gains(self, own: FloatArray) -> FloatArray:
        """Log of the expected improvement on given incumbents, shape (m,), whatever the top is; shape (m,)."""
        improvement = log_normalized_improvement((self.mean - own - self.level.resolution) / self.sd)
        value: FloatArray = np.log(self.sd) + improvement + self.log_chance
        return value

    @property
    def log_reach(self) -> FloatArray:
        """Log probability to reach the top level, shape (m,)."""
        value: FloatArray = log_ndtr((self.mean - self.level.top) / self.sd) + self.log_chance
        return value

    @property
    def confirmed(self) -> npt.NDArray[np.bool_]:
        """Whether the incumbent has reached the top level and about what its basin promises, shape (m,)."""
        promised = self.mean - TOP_SHARE * self.level.spread
        return self.own >= np.maximum(self.level.top, promised)

    def after(self, belief: Belief) -> View:
        """The same candidates after the last point of ``belief`` has been assumed."""
        mean, sd = belief.predict(self.candidates)
        point, value = belief.U[-1], belief.y[-1]
        hopeful = np.flatnonzero(value > self.own)
        hopeful = hopeful[basins.within_reach(belief, self.candidates[hopeful], point, self.reach[hopeful])]
        ends = np.broadcast_to(point, (len(hopeful), len(point)))
        own, index = self.own.copy(), self.index.copy()
        hopeful = hopeful[basins.same_basin(belief, self.candidates[hopeful], ends, self.level.slack)]
        own[hopeful], index[hopeful] = value, len(belief.y) - 1
        coordinates = basins.Coordinates(belief)
        from_point = np.linalg.norm(coordinates(self.candidates) - coordinates(point[None]), axis=1)
        return replace(
            self, belief=belief, mean=mean, sd=sd, log_chance=belief.log_chances(self.candidates),
            own=own, index=index, gap=np.minimum(self.gap, from_point),
        )  # fmt: skip

    @property
    def unknown(self) -> npt.NDArray[np.bool_]:
        """Which candidates may be explored, shape (m,): their basin is not confirmed, and no observation beside them.

        Around a summit that is known better than the model can follow, the model sees basins where there are none.
        """
        return ~self.confirmed & (self.gap >= basins.SAME_MAXIMUM)

    @property
    def incumbents(self) -> npt.NDArray[np.int64]:
        """Indices of the incumbents, without repeats."""
        return np.unique(self.index[self.index != NO_INCUMBENT])


def look(belief: Belief, candidates: FloatArray, level: Level) -> View:
    """Look at candidates, shape (m, d)."""
    mean, sd = belief.predict(candidates)
    near = basins.local_incumbents(belief, candidates, belief.U, belief.y, NEIGHBOURS, level.slack)
    own = np.where(near.index != NO_INCUMBENT, belief.y[near.index], np.min(belief.y))
    log_chance = belief.log_chances(candidates)
    return View(belief, candidates, level, mean, sd, log_chance, own, near.index, near.reach, near.gap)


def _effort(belief: Belief) -> tuple[int, int]:
    """Points of the net, and how many of its maxima of each kind are climbed."""
    planar = belief.dim <= 2
    size = NET_SIZE if planar else NET_SIZE_ABOVE_2D
    limit = MAX_CANDIDATES if planar else MAX_CANDIDATES_ABOVE_2D
    while size * len(belief.U) > NET_WORK and size > SMALLEST_NET:
        size, limit = size // 2, max(limit // 2, MAX_CANDIDATES_ABOVE_2D)
    return size, limit


def find_candidates(belief: Belief, level: Level, rng: np.random.Generator) -> FloatArray:
    """Local maxima of mean plus standard deviation, of the mean, and of the chance of the top, shape (m, d)."""
    coordinates = basins.Coordinates(belief)
    planar = belief.dim <= 2
    size, limit = _effort(belief)
    fresh = basins.search_net(belief, size, rng)
    if not planar:
        fresh = np.concatenate([fresh, basins.local_net(belief, size // 2, rng)])
    net = np.concatenate([fresh, belief.U])
    predictions = zip(belief.predict(fresh), belief.predict_observed(), strict=True)
    mean, sd = (np.concatenate(parts) for parts in predictions)
    log_chance = belief.log_chances(net)
    neighbourhoods = basins.Net(coordinates(net), 2 * belief.dim + 2)

    def maxima(values: FloatArray) -> FloatArray:
        return net[neighbourhoods.maxima(values, limit)]

    hopeful, peaks = maxima(belief.lifted(mean + sd, log_chance)), maxima(belief.lifted(mean, log_chance))
    improbable = maxima(log_ndtr((mean - level.top) / sd) + log_chance)
    scales = coordinates.scales(net)
    points = np.concatenate(
        [
            basins.ascend(belief.optimistic, hopeful, scales, 10),
            basins.ascend(expected(belief), peaks, scales, 16),
            improbable,
        ]
    )
    mean, sd = belief.predict(points)
    order = belief.lifted(mean + sd, belief.log_chances(points))
    return points[basins.distinct(order, coordinates(points), basins.SAME_MAXIMUM)]


def expected(belief: Belief) -> basins.ValueAndGradient:
    """Mean, with its gradient."""

    def function(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return belief.predict_mean(points), belief.mean_gradient(points)

    return function


def refine(
    belief: Belief,
    start: FloatArray,
    own: float,
    top: float | None,
    box: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Climb what a trial is worth from ``start``, shape (d,), and return the end, shape (d,).

    Args:
        belief: what is believed.
        start: where to begin.
        own: value of the incumbent to improve on.
        top: level whose probability counts as well; None for the improvement alone.
        box: corners of the box to stay in, shape (d,) each; None for the cube.
    """
    improvement = LogExpectedImprovement(own)
    reach = None if top is None else LogProbabilityOfImprovement(top)

    def objective(u: FloatArray) -> tuple[float, FloatArray]:
        mean, sd, d_mean, d_sd = belief.predict_with_gradients(u[None])
        by_mean, by_sd = improvement.partials(mean, sd)
        value = improvement.value(mean, sd)
        if reach is not None:
            value = value + reach.value(mean, sd)
            reach_by_mean, reach_by_sd = reach.partials(mean, sd)
            by_mean, by_sd = by_mean + reach_by_mean, by_sd + reach_by_sd
        gradient = by_mean[:, None] * d_mean + by_sd[:, None] * d_sd
        log_chance, d_log_chance = belief.log_chances_with_gradients(u[None])
        # Twice: the trial may fail on the plateau, and then its basin does not reach the top either.
        times = 1.0 if reach is None else 2.0
        return -float(value[0] + times * log_chance[0]), -(gradient[0] + times * d_log_chance[0])

    lower, upper = box if box is not None else (np.zeros(len(start)), np.ones(len(start)))
    result = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(lower, upper, strict=True)),
        options={"maxiter": 30, "ftol": REFINED},
    )
    before = objective(start)[0]
    point: FloatArray = np.clip(result.x, lower, upper) if result.fun < before else start
    return point
