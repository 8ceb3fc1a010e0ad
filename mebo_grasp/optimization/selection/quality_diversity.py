"""The final set of CL-MEBO: the combination of one point a cluster that maximizes QD (thesis 5.3.2)."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

IndexArray = npt.NDArray[np.int64]

MAX_COMBINATIONS = 50_000
"""Up to this number all combinations are compared; beyond it one member is exchanged at a time."""


def quality_diversity(
    X: FloatArray, quality: FloatArray, sets: IndexArray, min_distance: float
) -> FloatArray:
    """QD of several sets: M_d · mean nearest-neighbour distance · (least quality + mean quality).

    M_d is the number of mutually diverse members: best first, each that keeps the distance from all
    better ones that count.

    Args:
        X: points, shape (n, d), real units.
        quality: non-negative values, shape (n,).
        sets: indices of the members, shape (s, M).
        min_distance: distance at which two count as different.

    Returns:
        QD of each set, shape (s,).
    """
    size = sets.shape[1]
    values = quality[sets]
    merit: FloatArray = values.min(axis=1) + values.mean(axis=1)
    if size == 1:
        return merit
    order = np.argsort(-values, axis=1, kind="stable")
    ranked = np.take_along_axis(sets, order, axis=1)
    points = X[ranked]
    distances = np.linalg.norm(points[:, :, None, :] - points[:, None, :, :], axis=3)
    distances[:, np.arange(size), np.arange(size)] = np.inf
    nearest = distances.min(axis=2).mean(axis=1)
    counts = np.zeros((len(sets), size), dtype=bool)
    for i in range(size):
        clashes = counts[:, :i] & (distances[:, i, :i] < min_distance)
        counts[:, i] = ~clashes.any(axis=1)
    result: FloatArray = counts.sum(axis=1) * nearest * merit
    return result


def best_combination(
    X: FloatArray, y: FloatArray, clusters: list[IndexArray], min_distance: float
) -> IndexArray:
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
    quality = y - y.min()
    if np.prod([float(len(members)) for members in clusters]) <= MAX_COMBINATIONS:
        sets = np.array(list(product(*clusters)), dtype=np.int64)
        chosen = sets[int(np.argmax(quality_diversity(X, quality, sets, min_distance)))]
    else:
        chosen = _exchange(X, quality, clusters, min_distance)
    ranked: IndexArray = chosen[np.argsort(-y[chosen], kind="stable")]
    return ranked


def _exchange(
    X: FloatArray, quality: FloatArray, clusters: list[IndexArray], min_distance: float
) -> IndexArray:
    """Start from each cluster's best point and exchange one member at a time while QD grows."""
    chosen = np.array([members[int(np.argmax(quality[members]))] for members in clusters], dtype=np.int64)
    best = float(quality_diversity(X, quality, chosen[None], min_distance)[0])
    improved = True
    while improved:
        improved = False
        for slot, members in enumerate(clusters):
            sets = np.repeat(chosen[None], len(members), axis=0)
            sets[:, slot] = members
            values = quality_diversity(X, quality, sets, min_distance)
            if values.max() > best * (1.0 + 1e-12) + 1e-300:
                best, chosen, improved = float(values.max()), sets[int(np.argmax(values))], True
    return chosen
