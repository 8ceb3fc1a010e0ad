"""ROBOT: rank-ordered trust regions on one global surrogate (Maus et al. 2022; thesis 4.4)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.errors import RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.base import IndexArray, MethodSettings, state_int
from mebo_grasp.optimization.methods.common import DEFAULT_NUM_SOLUTIONS
from mebo_grasp.optimization.methods.surrogate_method import SurrogateMethod
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set
from mebo_grasp.optimization.selection.trust_region import TrustRegion, candidates_in_box, improves
from mebo_grasp.optimization.surrogate.posterior import Posterior

N_FEATURES = 256
"""Spectral features of a draw; its values at the observations are exact whatever their number."""


class Robot(SurrogateMethod):
    """M trust regions; the i-th seeks the best point that is different from those of ranks above it.

    The centre of region i is the best observation at distance tau or more from the centres of all regions
    before it. A batch takes the regions in turn; in each, the point is the feasible candidate that is
    greatest in a function drawn from the posterior (Thompson sampling).

    Differences to the published code, which is for hundreds of dimensions: an exact Gaussian process in
    place of the deep-kernel variational one, and TuRBO's own tolerances (3 successes, max(4, d) failures).
    """

    name = "robot"

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self._n_regions = settings.num_solutions or DEFAULT_NUM_SOLUTIONS
        self._regions = [TrustRegion() for _ in range(self._n_regions)]
        self._incumbents: list[float | None] = [None] * self._n_regions
        self._assigned: list[tuple[int, list[float]]] = []
        self._seen = 0
        self._seen_failed = 0
        self._turn = 0

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Take the next regions in turn and draw a point in each, shape (count, d)."""
        self._digest(observations)
        centres = observations.U[self._centre_indices(observations)]
        points = []
        for _ in range(count):
            rank = self._turn % len(centres)
            self._turn += 1
            point = self._draw(posterior, centres, rank, rng)
            points.append(point)
            self._phase = f"region {rank + 1}"
        return np.array(points)

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Choose a batch and remember which region each point belongs to, shape (count, d)."""
        first = self._turn
        points = super().propose(observations, count, rng)
        if self._turn > first:
            n_centres = len(self._centre_indices(observations))
            self._assigned += [((first + i) % n_centres, u.tolist()) for i, u in enumerate(points)]
        return points

    def _centre_indices(self, observations: Observations) -> IndexArray:
        sides, distance = self.metric()
        return greedy_diverse_set(observations.U * sides, observations.y, self._n_regions, distance)

    def _digest(self, observations: Observations) -> None:
        """Let the regions grow or shrink by the results that came in since the last batch."""
        results: dict[int, list[float]] = {}
        for u, value in zip(observations.U[self._seen :], observations.y[self._seen :], strict=True):
            self._collect(results, u, float(value))
        for u in observations.failed[self._seen_failed :]:
            self._collect(results, u, -np.inf)
        self._seen, self._seen_failed = observations.n, len(observations.failed)
        tolerance = max(4, self.space.dim)
        for rank, values in results.items():
            incumbent = self._incumbents[rank]
            improved = incumbent is None or improves(max(values), incumbent)
            self._regions[rank] = self._regions[rank].after(improved, tolerance)
        for rank, index in enumerate(self._centre_indices(observations)):
            self._incumbents[rank] = float(observations.y[index])

    def _collect(self, results: dict[int, list[float]], u: FloatArray, value: float) -> None:
        """File a result under the region that asked for it; results of others belong to none."""
        point = u.tolist()
        for i, (rank, asked) in enumerate(self._assigned):
            if asked == point:
                results.setdefault(rank, []).append(value)
                del self._assigned[i]
                return

    def _draw(self, posterior: Posterior, centres: FloatArray, rank: int, rng: np.random.Generator) -> FloatArray:
        """Thompson sample in one region, subject to the distance from the centres before it, shape (d,)."""
        lower, upper = self._regions[rank].box(centres[rank], posterior.lengthscales)
        candidates = candidates_in_box(lower, upper, centres[rank], rng)
        sides, distance = self.metric()
        gaps = np.linalg.norm((candidates[:, None] - centres[None, :rank]) * sides, axis=2)
        feasible = np.all(gaps >= distance, axis=1)
        values = posterior.sample_path(rng, N_FEATURES)(candidates)
        if np.any(feasible):
            values = np.where(feasible, values, -np.inf)
        chosen: FloatArray = candidates[int(np.argmax(values))]
        return chosen

    def state(self) -> dict[str, Any]:
        """The surrogate's state, the regions and the points under way."""
        return {
            **super().state(),
            "regions": [[r.length, r.successes, r.failures] for r in self._regions],
            "incumbents": list(self._incumbents),
            "assigned": [[rank, u] for rank, u in self._assigned],
            "seen": self._seen,
            "seen_failed": self._seen_failed,
            "turn": self._turn,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        try:
            regions = [TrustRegion(float(a), int(b), int(c)) for a, b, c in state["regions"]]
            incumbents = [None if v is None else float(v) for v in state["incumbents"]]
            assigned = [(int(rank), [float(c) for c in u]) for rank, u in state["assigned"]]
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the trust regions' state is unreadable: {error!r}") from error
        if len(regions) != self._n_regions or len(incumbents) != self._n_regions:
            raise RunLogError(f"expected {self._n_regions} trust regions, got {len(regions)}")
        self._regions, self._incumbents, self._assigned = regions, incumbents, assigned
        self._seen = state_int(state, "seen")
        self._seen_failed = state_int(state, "seen_failed")
        self._turn = state_int(state, "turn")
