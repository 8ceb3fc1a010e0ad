"""Constraint active search: cover the region above a threshold (Malkomes et al. 2021)."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.methods.surrogate_method import SurrogateMethod
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.selection.coverage import ball_offsets, ball_reach, expected_coverage_improvement
from mebo_grasp.optimization.surrogate.posterior import Posterior

DEFAULT_QUANTILE = 0.9
"""Without a threshold in the settings, good means at least this quantile of the values so far."""

N_POOL, N_CANDIDATES, N_REFINED = 1024, 48, 24
"""Points that are ranked, those of them whose coverage is computed, and points about the best in each refinement."""
N_OFFSETS = 64
"""Points of a ball by which its coverage is estimated."""
REFINEMENTS = (0.3, 0.1)
"""Standard deviations of the points about the best one, radii of a ball."""


class ConstraintActiveSearch(SurrogateMethod):
    """Each point is the one with the greatest expected coverage improvement; pending points count as tried.

    The radius is ``min_distance`` of the settings, or a tenth of the cube's diagonal.
    """

    name = "constraint_active_search"

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose points one after the other, each counting as tried for the next, shape (count, d)."""
        threshold = self.settings.threshold
        if threshold is None:
            threshold = float(np.quantile(observations.y, DEFAULT_QUANTILE))
        sides, radius = self.metric()
        tried = observations.taken
        points = np.empty((0, posterior.dim))
        for _ in range(count):
            point = self._best(posterior, np.concatenate([tried, points]), threshold, sides, radius, rng)
            points = np.concatenate([points, point[None]])
        return points

    @staticmethod
    def _best(
        posterior: Posterior,
        tried: FloatArray,
        threshold: float,
        sides: FloatArray,
        radius: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Rank a pool by the chance of being good and uncovered, then the best by ECI, then around them."""
        dim, reach = posterior.dim, ball_reach(radius, sides)
        # Half of the pool lies about one radius from tried points, where the border of what is covered runs.
        around = tried[rng.integers(0, len(tried), N_POOL // 2)]
        steps = ball_offsets(N_POOL // 2, dim, rng) * (2.0 * reach)
        pool = np.concatenate([sobol(N_POOL // 2, dim, rng), np.clip(around + steps, 0.0, 1.0)])
        mean, sd = posterior.predict(pool)
        gaps = np.min(np.linalg.norm((pool[:, None] - tried[None]) * sides, axis=2), axis=1)
        chance = ndtr((mean - threshold) / sd) * np.minimum(gaps / radius, 1.0)
        candidates = pool[np.argsort(-chance, kind="stable")[:N_CANDIDATES]]
        offsets = ball_offsets(N_OFFSETS, dim, rng)
        for width in REFINEMENTS:
            worth = expected_coverage_improvement(posterior, candidates, offsets, tried, threshold, sides, radius)
            best = candidates[int(np.argmax(worth))]
            moves = width * reach * rng.standard_normal((N_REFINED, dim))
            candidates = np.concatenate([best[None], np.clip(best + moves, 0.0, 1.0)])
        worth = expected_coverage_improvement(posterior, candidates, offsets, tried, threshold, sides, radius)
        chosen: FloatArray = candidates[int(np.argmax(worth))]
        return chosen
