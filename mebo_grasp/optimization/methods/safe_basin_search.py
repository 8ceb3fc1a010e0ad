"""Basin search under input noise: a part of the trials, and the solutions, go by what is expected of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.unscented import UnscentedTransform, unscented_outcomes
from mebo_grasp.optimization.methods.base import IndexArray, MethodSettings, Outcomes, state_int
from mebo_grasp.optimization.methods.basin_search import BasinSearch
from mebo_grasp.optimization.methods.common import without_repeats
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection import basins
from mebo_grasp.optimization.selection.basin_views import level_of
from mebo_grasp.optimization.selection.safe_search import pick_safe
from mebo_grasp.optimization.surrogate.belief import shows_too_little

SAFE_PERIOD = 2
"""One trial in this many goes where most is expected under the noise; the others look for basins as ever."""

NOISE_PAIRS = 16
"""Draws of the noise, each with its opposite, over which beliefs are averaged: a plateau's cliff is no quadratic."""

CAUTION = 0.4
"""What a standard deviation under the noise costs a point's rank. Beliefs of the best grasps were off by 2 to 10 % in
hundreds of executions, and of those that they cannot tell apart the first often stands beside a cliff."""


class SafeBasinSearch(BasinSearch):
    """The default method for ``safe`` runs, under the same name."""

    _turns = 0

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self.transform = UnscentedTransform.of_draws(settings.input_noise.in_cube(space), NOISE_PAIRS)

    def outcomes(self, observations: Observations) -> Outcomes:
        """What the most probable belief expects; ranked by that less ``CAUTION`` standard deviations."""
        if observations.n == 0:
            return Outcomes(*np.empty((4, 0)))
        assert self.transform is not None
        belief = self.surrogate.belief(observations.U, observations.y)
        expected, sd, worst = unscented_outcomes(belief.predict_mean, observations.U, self.transform)
        return Outcomes(expected, sd, worst, expected - CAUTION * sd)

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the next points, shape (count, d)."""
        turns = [(self._turns + i) % SAFE_PERIOD == 0 for i in range(count)]
        n_safe = sum(turns) if observations.n and not shows_too_little(observations.y) else 0
        self._turns += max(count, 0)
        if n_safe == 0:
            return super().propose(observations, count, rng)
        if n_safe < count:
            points = super().propose(observations, count - n_safe, rng)
            belief = self.surrogate.belief(observations.U, observations.y)
        else:
            points = np.empty((0, observations.dim))
            belief = self.surrogate.update(observations.U, observations.y, rng).best
            self._phase = "safe"
        assert self.transform is not None
        assumed = np.concatenate([observations.without_value, points])
        belief = belief.condition_on(assumed) if len(assumed) else belief
        for _ in range(n_safe):
            point = pick_safe(belief, self.transform, rng)
            points = np.concatenate([points, point[None]])
            belief = belief.condition_on(point[None])
        return without_repeats(points, observations, rng)

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """The observation of each basin that is expected to do best, in that order; apart by a distance if given."""
        size = size if size is not None else self.settings.num_solutions
        distance = min_distance if min_distance is not None else self.settings.min_distance
        if observations.n == 0 or distance is not None:
            return super().solution_set(observations, size, distance)
        belief = self.surrogate.belief(observations.U, observations.y)
        ranking, level = self.ranking(observations), level_of(belief)
        floor = float(np.max(ranking)) - 0.5 * level.spread
        return basins.representatives(belief, observations.U, ranking, 10 * level.slack, size, floor)

    def state(self) -> dict[str, Any]:
        """That of basin search and the turn."""
        return {**super().state(), "turns": self._turns}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self._turns = state_int(state, "turns")
