"""Cluster expected improvement, a local EI for one cluster (thesis 5.3.1, "Cluster sampling")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement


@dataclass(frozen=True, eq=False)
class ClusterExpectedImprovement:
    """EI over the cluster's best value, damped where another centroid is nearer.

    CL-EI(x) = EI(x, best of the cluster) · min_C ‖x - C‖ / ‖x - C_s‖. At the cluster's own centroid, where
    the quotient reads 0 / 0, it is 1, its limit.

    Args:
        incumbent: best value in the cluster, units of y.
        centroids: of all clusters, shape (k, d), unit cube.
        own: index of the cluster that is sampled.
    """

    incumbent: float
    centroids: FloatArray
    own: int

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "cluster_ei"

    def value_at(self, A: FloatArray, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Worth, shape (m,), of points A, shape (m, d), with posterior ``mean`` and ``sd``, shape (m,)."""
        distances = np.linalg.norm(A[:, None, :] - self.centroids[None, :, :], axis=2)
        own = distances[:, self.own]
        damping = np.where(own > 0.0, distances.min(axis=1) / np.where(own > 0.0, own, 1.0), 1.0)
        worth: FloatArray = ExpectedImprovement(self.incumbent).value(mean, sd) * damping
        return worth
