"""CL-MEBO: explore, then refine in clusters of good observations (thesis 5.3 and appendix C)."""

from __future__ import annotations

from math import ceil

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.cluster_improvement import ClusterExpectedImprovement
from mebo_grasp.optimization.methods.base import IndexArray
from mebo_grasp.optimization.methods.common import DEFAULT_NUM_SOLUTIONS
from mebo_grasp.optimization.methods.e_mebo import CANDIDATES_PER_POINT, EMebo
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.selection.boltzmann import Box, draw
from mebo_grasp.optimization.selection.clustering import Cluster, choose_clusters, find_clusters
from mebo_grasp.optimization.selection.explorative import most_distant_subset
from mebo_grasp.optimization.selection.quality_diversity import best_combination
from mebo_grasp.optimization.surrogate.posterior import Posterior

BOX_MARGIN = 0.04
"""Half side of the box round a centroid that a cluster's search box contains at least (thesis's code)."""


class ClMebo(EMebo):
    """Cluster MEBO: explorative, then ordinary, then more and more often cluster batches."""

    name = "cl_mebo"

    def select(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Choose the batch by the schedule of appendix C, shape (count, d)."""
        step = self.scheduled(self.spent(observations), self._iteration)
        self._iteration += 1
        if step == "explorative":
            return self.explorative(posterior, observations, count, rng)
        if step == "boltzmann":
            return Mebo.select(self, posterior, observations, count, rng)
        return self.cluster_batch(posterior, observations, count, rng)

    @staticmethod
    def scheduled(spent: float, iteration: int) -> str:
        """What an iteration does once this share of the budget is spent (appendix C, lines 8 to 24)."""
        if spent < 0.4:
            return "explorative"
        if spent < 0.5:
            return "boltzmann"
        if spent < 0.7:
            return "boltzmann" if iteration % 2 == 0 else "clusters"
        if spent < 0.9:
            return "boltzmann" if iteration % 3 == 0 else "clusters"
        return "clusters"

    def cluster_batch(
        self, posterior: Posterior, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        """Cluster batch sampling, or explorative sampling when too few clusters are found (thesis 5.3.1)."""
        wanted = self.settings.num_solutions or DEFAULT_NUM_SOLUTIONS
        sides, distance = self.metric()
        clusters = find_clusters(observations.U, observations.y, wanted, sides, distance, rng)
        if len(clusters) < ceil(self.settings.cluster_share * wanted):
            return self.explorative(posterior, observations, count, rng)
        self._phase = "clusters"
        times = choose_clusters(clusters, observations.y, count)
        batches = [
            self._sample_cluster(posterior, observations, clusters, i, int(n), rng)
            for i, n in enumerate(times)
            if n > 0
        ]
        return np.concatenate(batches)

    def _sample_cluster(
        self,
        posterior: Posterior,
        observations: Observations,
        clusters: list[Cluster],
        own: int,
        n: int,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw n points by CL-EI in the box of one cluster, shape (n, d)."""
        members = observations.U[clusters[own].members]
        centroid = clusters[own].centroid
        box = Box(
            np.clip(np.minimum(members.min(axis=0), centroid - BOX_MARGIN), 0.0, 1.0),
            np.clip(np.maximum(members.max(axis=0), centroid + BOX_MARGIN), 0.0, 1.0),
        )
        acquisition = ClusterExpectedImprovement(
            float(observations.y[clusters[own].members].max()), np.stack([c.centroid for c in clusters]), own
        )
        n_candidates = 1 if n == 1 else n * CANDIDATES_PER_POINT
        candidates = draw(posterior, [acquisition], rng, self.boltzmann, n_candidates, box, self.transform)[0]
        chosen: FloatArray = candidates[most_distant_subset(candidates, n)]
        return chosen

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """The combination of one point a cluster with the greatest QD (thesis 5.3.2).

        Clusters are those of the batches, but not merged. With too few points for the clusters, or with one
        solution wanted, the answer is the greedy one.
        """
        wanted = size or self.settings.num_solutions or DEFAULT_NUM_SOLUTIONS
        if wanted < 2 or observations.n < wanted:
            return super().solution_set(observations, wanted, min_distance)
        sides, distance = self.metric(min_distance)
        # A fixed seed: the answer depends on the observations alone, however often it is asked for.
        rng = np.random.default_rng(0)
        ranking = self.ranking(observations)
        clusters = find_clusters(observations.U, ranking, wanted, sides, distance, rng, merge=False, lowest_decile=0)
        return best_combination(observations.U * sides, ranking, [cluster.members for cluster in clusters], distance)
