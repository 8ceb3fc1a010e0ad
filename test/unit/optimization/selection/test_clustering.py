import numpy as np
import pytest
from sklearn.cluster import KMeans

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.selection.clustering import (
    Cluster,
    bayesian_information,
    choose_clusters,
    find_clusters,
    inertia,
    kmeans,
    lloyd,
    mean_normalized,
    merge_close,
    xmeans,
)

CENTRES = np.array([[0.1, 0.1], [0.9, 0.2], [0.5, 0.9], [0.1, 0.8], [0.6, 0.4]])


def blobs(sizes=(20, 20, 20, 20, 20), sd=0.02, seed=0):
    rng = np.random.default_rng(seed)
    pairs = zip(CENTRES, sizes, strict=False)
    return np.concatenate([c + sd * rng.standard_normal((n, 2)) for c, n in pairs])


def test_kmeans_is_as_good_as_scikit_learns():
    X = np.random.default_rng(1).random((150, 3))
    ours = inertia(X, *kmeans(X, 6, np.random.default_rng(0), repeats=30))
    theirs = KMeans(6, n_init=30, random_state=0).fit(X).inertia_
    assert ours <= 1.02 * theirs


def test_lloyd_ends_at_the_means_of_its_groups():
    X = np.random.default_rng(2).random((60, 2))
    centres, labels = lloyd(X, X[:4])
    for i in range(4):
        assert np.allclose(centres[i], X[labels == i].mean(axis=0))


def test_lloyd_leaves_no_centre_empty():
    centres, labels = lloyd(blobs(), np.full((3, 2), 0.5))
    assert set(labels) == {0, 1, 2}
    assert np.isfinite(centres).all()


def test_xmeans_finds_the_number_of_separate_blobs():
    centres, labels = xmeans(blobs(), 1, 12, np.random.default_rng(0))
    assert len(centres) == 5
    nearest = np.linalg.norm(centres[:, None] - CENTRES[None], axis=2)
    assert np.all(nearest.min(axis=0) < 0.02)
    assert np.all(np.bincount(labels) == 20)


def test_xmeans_does_not_split_one_blob_and_keeps_its_limit():
    X = blobs((200,))
    assert len(xmeans(X, 1, 8, np.random.default_rng(0))[0]) == 1
    assert len(xmeans(blobs(), 2, 3, np.random.default_rng(0))[0]) == 3
    with pytest.raises(InvalidSettingsError, match="k_max"):
        xmeans(X, 3, 2, np.random.default_rng(0))
    with pytest.raises(InvalidSettingsError, match="number of points"):
        kmeans(X[:2], 3, np.random.default_rng(0))


def test_bayesian_information_by_hand():
    # Four points on a line, two centres: residuals ±1, sum of squares 4, variance 4 / (1 (4 - 2)) = 2.
    X = np.array([[0.0], [2.0], [10.0], [12.0]])
    value = bayesian_information(X, np.array([[1.0], [11.0]]), np.array([0, 0, 1, 1]))
    log_likelihood = 4 * np.log(0.5) - 2.0 * np.log(2 * np.pi * 2.0) - 1.0
    assert value == pytest.approx(log_likelihood - 2.0 * np.log(4.0))


def clusters_at(*centroids):
    return [Cluster(np.array(c), np.array([10 * i, 10 * i + 1])) for i, c in enumerate(centroids)]


def test_correction_of_the_thesiss_figure():
    """Figure 5.3: C1 alone; C2 and C3 too close; C6 close to C4 and to C5, which are far from each other."""
    found = clusters_at([0.1, 0.9], [0.5, 0.9], [0.6, 0.95], [0.2, 0.2], [0.5, 0.2], [0.35, 0.2])
    merged = merge_close(found, np.ones(2), 0.2)
    assert len(merged) == 3
    members = {tuple(sorted(c.members)): c.centroid for c in merged}
    assert np.allclose(members[(0, 1)], [0.1, 0.9])
    assert np.allclose(members[(10, 11, 20, 21)], [0.55, 0.925])
    assert np.allclose(members[(30, 31, 40, 41, 50, 51)], [0.35, 0.2])


def test_correction_measures_in_real_units_and_counts_no_point_twice():
    found = clusters_at([0.0], [0.1], [0.25], [0.35])  # a chain: 0-1 close, 1-2 close, 2-3 close at 15
    merged = merge_close(found, np.array([100.0]), 16.0)
    members = np.concatenate([c.members for c in merged])
    assert len(members) == len(set(members)) == 8
    assert len(merge_close(found, np.array([100.0]), 9.0)) == 4
    assert merge_close([], np.ones(1), 1.0) == []


def test_regions_are_found_at_the_highest_decile_that_shows_them_all():
    rng = np.random.default_rng(3)
    U = np.concatenate([blobs(), rng.random((100, 2))])
    height = np.exp(-(np.linalg.norm(U[:, None] - CENTRES[None], axis=2).min(axis=1) ** 2) / 0.002)
    found = find_clusters(U, height, 5, np.ones(2), 0.15, np.random.default_rng(0))
    assert len(found) == 5
    assert all(height[c.members].min() >= np.quantile(height, 0.5) for c in found)
    nearest = np.linalg.norm(np.stack([c.centroid for c in found])[:, None] - CENTRES[None], axis=2)
    assert np.all(nearest.min(axis=0) < 0.05)


def test_too_few_regions_are_returned_as_they_are():
    U = blobs((30, 30))
    found = find_clusters(U, np.arange(60.0) % 30, 5, np.ones(2), 0.3, np.random.default_rng(0))
    assert len(found) == 2
    assert find_clusters(U[:3], np.arange(3.0), 5, np.ones(2), 0.3, np.random.default_rng(0)) == []


def test_scores_by_hand():
    assert np.allclose(mean_normalized(np.array([1.0, 2.0, 6.0])), [-0.4, -0.2, 0.6])
    assert np.array_equal(mean_normalized(np.full(3, 7.0)), np.zeros(3))


def test_small_and_low_clusters_come_first_and_lose_priority():
    y = np.array([1.0, 5.0, 5.0, 5.0, 9.0, 9.0, 9.0, 9.0])
    clusters = [
        Cluster(np.zeros(1), np.array([0])),  # lowest and smallest
        Cluster(np.ones(1), np.array([1, 2, 3])),
        Cluster(np.ones(1), np.array([4, 5, 6, 7])),  # highest and largest: never
    ]
    # V = (-.5, 0, .5), W = (-5/9, 1/9, 4/9): scores (-1.056, .111, .944), priorities (2, .833, 0).
    # Choices: 2 → 1.8 → 1.44 → 1.008 → .605 < .833, so the fifth is the second cluster.
    assert choose_clusters(clusters, y, 3).tolist() == [3, 0, 0]
    assert choose_clusters(clusters, y, 5).tolist() == [4, 1, 0]


def test_equal_clusters_take_turns():
    clusters = [Cluster(np.zeros(1), np.array([i])) for i in range(4)]
    assert choose_clusters(clusters, np.ones(4), 6).tolist() == [2, 2, 1, 1]
