"""The final set of CL-MEBO: the combination of one point a cluster that maximizes QD (thesis 5.3.2)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from mebo_grasp.grasp import FloatArray
from mebo_grasp.quality_diversity import best_combination as best_rows

IndexArray = npt.NDArray[np.int64]


def best_combination(X: FloatArray, y: FloatArray, clusters: list[IndexArray], min_distance: float) -> IndexArray:
    """Choose one point of each cluster so that QD is greatest.

    Qualities are measured from the worst value observed, because a product with negative values would
    reward the opposite.

    Args:
        X: points, shape (n, d), real units.
        y: values, shape (n,).
        clusters: indices of each cluster's members.
        min_distance: distance at which two count as different.

    Returns:
        Indices, one a cluster, best value first.
    """
    members = np.concatenate(clusters)
    ends = np.cumsum([len(cluster) for cluster in clusters])[:-1]
    rows = np.split(np.arange(len(members)), ends)
    distances = cdist(X[members], X[members])
    chosen: IndexArray = members[best_rows(distances, y[members] - y.min(), rows, min_distance)]
    return chosen
