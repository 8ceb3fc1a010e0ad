"""Clusters of good observations: k-means++, x-means, correction by merging, priorities (thesis 5.3, C).

k-means is written out here because x-means calls it on dozens of small sets for every batch: scikit-learn's
costs 4 ms a start whatever the size, and adds up the centres in the order in which its threads finish, so
that a trace would not repeat bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray

IndexArray = npt.NDArray[np.int64]

MAX_LLOYD_STEPS = 100


@dataclass(frozen=True, eq=False)
class Cluster:
    """A group of observations.

    Args:
        centroid: shape (d,), unit cube.
        members: indices of the observations, shape (k,).
    """

    centroid: FloatArray
    members: IndexArray


def _squared_distances(X: FloatArray, centres: FloatArray) -> FloatArray:
    squared: FloatArray = np.sum((X[:, None, :] - centres[None, :, :]) ** 2, axis=2)
    return squared


def kmeans_plusplus(X: FloatArray, k: int, rng: np.random.Generator) -> FloatArray:
    """Draw k centres among the points, each with probability in proportion to its squared distance.

    Arthur and Vassilvitskii 2007. Returns centres, shape (k, d).
    """
    centres = X[[int(rng.integers(len(X)))]]
    while len(centres) < k:
        nearest = _squared_distances(X, centres).min(axis=1)
        total = nearest.sum()
        weights = nearest / total if total > 0.0 else np.full(len(X), 1.0 / len(X))
        centres = np.concatenate([centres, X[[int(rng.choice(len(X), p=weights))]]])
    return centres


def lloyd(X: FloatArray, centres: FloatArray) -> tuple[FloatArray, IndexArray]:
    """Move centres to the means of their points until no point changes its centre.

    A centre that loses all its points moves to the point farthest from its centre.

    Args:
        X: points, shape (n, d).
        centres: where to start, shape (k, d), k <= n.

    Returns:
        (centres (k, d), label of each point (n,)).
    """
    centres, k = centres.copy(), len(centres)
    labels = np.full(len(X), -1)
    for _ in range(MAX_LLOYD_STEPS):
        squared = _squared_distances(X, centres)
        new_labels = np.argmin(squared, axis=1)
        counts = np.bincount(new_labels, minlength=k)
        if np.any(counts == 0):
            worst = np.argsort(-squared[np.arange(len(X)), new_labels], kind="stable")
            for empty, point in zip(np.flatnonzero(counts == 0), worst, strict=False):
                centres[empty] = X[point]
                new_labels[point] = empty
            counts = np.bincount(new_labels, minlength=k)
        if np.array_equal(new_labels, labels):
            break
        labels = new_labels
        for q in range(X.shape[1]):
            sums = np.bincount(labels, weights=X[:, q], minlength=k)
            centres[:, q] = np.where(counts > 0, sums / np.maximum(counts, 1), centres[:, q])
    return centres, labels


def inertia(X: FloatArray, centres: FloatArray, labels: IndexArray) -> float:
    """Sum of squared distances of the points to their centres."""
    return float(np.sum((X - centres[labels]) ** 2))


def kmeans(X: FloatArray, k: int, rng: np.random.Generator, repeats: int = 5) -> tuple[FloatArray, IndexArray]:
    """Best of several k-means++ starts. Returns (centres (k, d), labels (n,)).

    Raises:
        InvalidSettingsError: k is below 1 or above the number of points.
    """
    if not 1 <= k <= len(X):
        raise InvalidSettingsError(f"k must lie between 1 and the number of points {len(X)}, got {k}")
    runs = [lloyd(X, kmeans_plusplus(X, k, rng)) for _ in range(repeats)]
    return min(runs, key=lambda run: inertia(X, *run))


def bayesian_information(X: FloatArray, centres: FloatArray, labels: IndexArray) -> float:
    """BIC of a mixture of equal spherical normals with hard assignment, larger is better.

    Pelleg and Moore 2000, equations of section 3.2: log likelihood minus half the number of free
    parameters, k (d + 1), times log n, with the unbiased pooled variance.
    """
    n, dim = X.shape
    k = len(centres)
    if n <= k:
        return -np.inf
    variance = max(inertia(X, centres, labels) / (dim * (n - k)), 1e-300)
    counts = np.bincount(labels, minlength=k)
    counts = counts[counts > 0]
    log_likelihood = float(np.sum(counts * np.log(counts / n)))
    log_likelihood -= 0.5 * n * dim * float(np.log(2.0 * np.pi * variance)) + 0.5 * dim * (n - k)
    return float(log_likelihood - 0.5 * k * (dim + 1) * np.log(n))


def xmeans(
    X: FloatArray, k_start: int, k_max: int, rng: np.random.Generator, repeats: int = 5
) -> tuple[FloatArray, IndexArray]:
    """Start from k-means with ``k_start`` centres and split those whose halves have the better BIC.

    Pelleg and Moore 2000. The splits with the greatest gain come first when ``k_max`` limits them.

    Args:
        X: points, shape (n, d).
        k_start: centres at the start.
        k_max: most centres.
        rng: source of randomness.
        repeats: k-means++ starts.

    Returns:
        (centres (k, d), labels (n,)).

    Raises:
        InvalidSettingsError: not 1 <= k_start <= k_max, or fewer points than k_start.
    """
    if k_start > k_max:
        raise InvalidSettingsError(f"k_start {k_start} must not exceed k_max {k_max}")
    centres, labels = kmeans(X, k_start, rng, repeats)
    while len(centres) < k_max:
        splits = _useful_splits(X, centres, labels, rng, repeats)
        if not splits:
            break
        room = k_max - len(centres)
        chosen = {index: halves for _, index, halves in splits[:room]}
        grown = [chosen.get(i, centres[[i]]) for i in range(len(centres))]
        centres, labels = lloyd(X, np.concatenate(grown))
    return centres, labels


def _useful_splits(
    X: FloatArray, centres: FloatArray, labels: IndexArray, rng: np.random.Generator, repeats: int
) -> list[tuple[float, int, FloatArray]]:
    """Splits that raise the BIC, greatest gain first: (-gain, index of the centre, its two halves)."""
    splits = []
    for i in range(len(centres)):
        own = X[labels == i]
        if len(own) < 4:
            continue
        whole = bayesian_information(own, own.mean(axis=0)[None], np.zeros(len(own), dtype=np.int64))
        halves, half_labels = kmeans(own, 2, rng, repeats)
        gain = bayesian_information(own, halves, half_labels) - whole
        if gain > 0.0:
            splits.append((-gain, i, halves))
    return sorted(splits, key=lambda split: split[:2])


def merge_close(clusters: list[Cluster], sides: FloatArray, min_distance: float) -> list[Cluster]:
    """Cluster correction (appendix C): merge clusters whose centroids are closer than ``min_distance``.

    Each cluster has a group: itself and all closer than the distance. A cluster alone in its group stays.
    Any other goes with the largest group that contains it; each group chosen so becomes one cluster, whose
    centroid is the mean of the group's centroids. A cluster that ended up in a merged group already is not
    merged a second time, which the pseudocode leaves open and would count its points twice.

    Args:
        clusters: as found.
        sides: lengths of the cube's sides in which distances count, shape (d,).
        min_distance: smallest distance at which two count as different, in the unit of ``sides``.

    Returns:
        Clusters whose number tells how many different regions there are.
    """
    if len(clusters) < 2:
        return list(clusters)
    centroids = np.stack([cluster.centroid for cluster in clusters]) * sides
    close = np.linalg.norm(centroids[:, None] - centroids[None], axis=2) < min_distance
    np.fill_diagonal(close, True)
    valid = [cluster for i, cluster in enumerate(clusters) if close[i].sum() == 1]
    merged = np.zeros(len(clusters), dtype=bool)
    # Largest groups first, so that a cluster shared by several goes with the largest.
    for i in np.argsort(-close.sum(axis=1), kind="stable"):
        if close[i].sum() == 1 or merged[i]:
            continue
        group = np.flatnonzero(close[i] & ~merged)
        merged[group] = True
        valid.append(
            Cluster(
                np.mean([clusters[j].centroid for j in group], axis=0),
                np.concatenate([clusters[j].members for j in group]),
            )
        )
    return valid


def find_clusters(
    U: FloatArray,
    y: FloatArray,
    count: int,
    sides: FloatArray,
    min_distance: float,
    rng: np.random.Generator,
    merge: bool = True,
    lowest_decile: int = 1,
) -> list[Cluster]:
    """Cluster computation (thesis 5.3.1): filter by deciles, from the ninth down.

    Args:
        U: observed points, shape (n, d), unit cube.
        y: their values, shape (n,).
        count: regions wanted, M.
        sides: see ``merge_close``.
        min_distance: see ``merge_close``.
        rng: source of randomness.
        merge: return merged clusters; otherwise the same decile's clusters as x-means left them.
        lowest_decile: where to stop; 0 takes all points in the end.

    Returns:
        ``count`` clusters if some decile gives them, else the largest number found (at the highest decile
        of equals); empty if there are too few points.
    """
    best: list[Cluster] = []
    best_size, previous = 0, -1
    for level in range(9, lowest_decile - 1, -1):
        members = np.flatnonzero(y >= np.quantile(y, level / 10.0)) if len(y) else np.empty(0, dtype=np.int64)
        # Ties in y (plateaus) make several deciles select the same points.
        if len(members) < count or len(members) == previous:
            continue
        previous = len(members)
        _, labels = xmeans(U[members], count, count, rng)
        found = [
            Cluster(U[members[labels == i]].mean(axis=0), members[labels == i])
            for i in range(count)
            if np.any(labels == i)
        ]
        corrected = merge_close(found, sides, min_distance)
        if len(corrected) > best_size:
            best, best_size = (corrected if merge else found), len(corrected)
        if best_size == count:
            break
    return best


def mean_normalized(values: FloatArray) -> FloatArray:
    """(values - mean) / (max - min), shape (k,); zeros if all are equal, where the formula is 0 / 0."""
    spread = float(np.ptp(values))
    if spread == 0.0:
        return np.zeros(len(values))
    normalized: FloatArray = (values - np.mean(values)) / spread
    return normalized


def choose_clusters(clusters: list[Cluster], y: FloatArray, batch: int) -> IndexArray:
    """Cluster selection (thesis 5.3.1): how often each cluster is chosen for a batch.

    Small clusters with a low maximum come first: their score, the sum of value score V and size score W, is
    lowest, and the priority is the greatest score minus theirs. Each choice multiplies the chosen
    cluster's priority by (1 - 0.1 B_C), B_C being the times it was chosen. Equal priorities go to the
    cluster chosen less often.

    Args:
        clusters: k of them.
        y: values of all observations.
        batch: choices to make.

    Returns:
        Times chosen, shape (k,).
    """
    value_score = mean_normalized(np.array([y[cluster.members].max() for cluster in clusters]))
    size_score = mean_normalized(np.array([float(len(cluster.members)) for cluster in clusters]))
    score = value_score + size_score
    priority = score.max() - score
    chosen = np.zeros(len(clusters), dtype=np.int64)
    for _ in range(batch):
        best = int(np.lexsort((chosen, -priority))[0])
        chosen[best] += 1
        priority[best] *= max(0.0, 1.0 - 0.1 * chosen[best])
    return chosen
