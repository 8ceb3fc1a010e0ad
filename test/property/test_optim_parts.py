"""Properties of the optimizer's parts that hold for any input."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement, LogExpectedImprovement
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.clustering import Cluster, choose_clusters, kmeans, merge_close
from mebo_grasp.optimization.selection.explorative import most_distant_subset
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL

UNIT = st.floats(0.0, 1.0)
QUICK = settings(max_examples=60, deadline=None)


def unit_points(min_size=1, max_size=12, dim=2):
    return st.integers(min_size, max_size).flatmap(lambda n: arrays(np.float64, (n, dim), elements=UNIT))


@QUICK
@given(u=arrays(np.float64, 3, elements=UNIT), low=st.floats(-1e6, 1e6), width=st.floats(1e-3, 1e6))
def test_space_round_trip_stays_in_the_box(u, low, width):
    space = SearchSpace(("a", "b", "c"), np.full(3, low), np.full(3, low + width))
    x = space.from_unit(u)
    assert space.contains(x)
    assert np.allclose(space.to_unit(x), u, atol=1e-9 * max(1.0, abs(low) / width))


@QUICK
@given(
    U=unit_points(),
    log_lengths=arrays(np.float64, 2, elements=st.floats(-4.0, 3.0)),
    kernel=st.sampled_from([MATERN52, SQUARED_EXPONENTIAL]),
)
def test_covariances_are_symmetric_bounded_and_positive_semidefinite(U, log_lengths, kernel):
    K = kernel.matrix(U, U, np.append(log_lengths, 0.0))
    assert np.allclose(K, K.T, atol=1e-14)
    assert np.all((K >= 0.0) & (K <= 1.0 + 1e-14))
    assert np.linalg.eigvalsh(K).min() > -1e-10


@QUICK
@given(data=st.data(), noise=st.floats(1e-6, 1.0))
def test_posterior_is_finite_and_no_wider_than_the_prior(data, noise):
    U = data.draw(unit_points())
    y = data.draw(arrays(np.float64, len(U), elements=st.floats(-1e6, 1e6)))
    hyper = Hyperparameters(np.array([-1.0, -0.5, 0.0]), float(np.log(noise)))
    gp = GaussianProcess.fit(U, y, hyper)
    mean, sd = gp.predict(np.vstack([U, data.draw(unit_points())]))
    assert np.all(np.isfinite(mean))
    assert np.all((sd > 0.0) & (sd <= gp.scale * (1.0 + 1e-9)))


@QUICK
@given(y=arrays(np.float64, st.integers(1, 9), elements=st.floats(-1e300, 1e300)))
def test_standardization_can_be_undone(y):
    z, centre, scale = standardize(y)
    assert np.all(np.isfinite(z))
    assert scale > 0.0
    assert np.allclose(z * scale + centre, y, rtol=1e-9, atol=1e-9 * np.max(np.abs(y)))


@QUICK
@given(mean=st.floats(-50, 50), sd=st.floats(1e-6, 50), incumbent=st.floats(-50, 50))
def test_improvement_is_non_negative_exceeds_the_gap_and_agrees_with_its_log(mean, sd, incumbent):
    value = ExpectedImprovement(incumbent).value(np.array([mean]), np.array([sd]))[0]
    log_value = LogExpectedImprovement(incumbent).value(np.array([mean]), np.array([sd]))[0]
    assert value >= max(0.0, mean - incumbent) - 1e-9
    assert np.isfinite(log_value)
    if value > 1e-9:
        assert np.isclose(np.log(value), log_value, atol=1e-6)


@QUICK
@given(
    X=unit_points(max_size=25),
    distance=st.floats(0.01, 1.0),
    size=st.integers(1, 6),
    seed=st.integers(0, 99),
)
def test_solution_sets_keep_the_distance_and_miss_nothing(X, distance, size, seed):
    y = np.random.default_rng(seed).random(len(X))
    chosen = greedy_diverse_set(X, y, size, distance)
    gaps = np.linalg.norm(X[chosen][:, None] - X[chosen][None], axis=2) + 9.0 * np.eye(len(chosen))
    assert 1 <= len(chosen) <= size
    assert gaps.min() >= distance
    if len(chosen) < size:  # every other point is too close to a better chosen one
        for i in set(range(len(X))) - set(chosen.tolist()):
            near = chosen[np.linalg.norm(X[chosen] - X[i], axis=1) < distance]
            assert np.any(y[near] >= y[i])


@QUICK
@given(X=unit_points(min_size=3), k=st.integers(1, 3), distance=st.floats(0.0, 1.5), seed=st.integers(0, 99))
def test_correction_only_regroups(X, k, distance, seed):
    _, labels = kmeans(X, k, np.random.default_rng(seed), repeats=1)
    found = [Cluster(X[labels == i].mean(axis=0), np.flatnonzero(labels == i)) for i in np.unique(labels)]
    corrected = merge_close(found, np.ones(2), distance)
    members = np.concatenate([cluster.members for cluster in corrected])
    assert sorted(members) == list(range(len(X)))
    assert len(corrected) <= len(found)
    chosen = choose_clusters(corrected, np.arange(float(len(X))), 5)
    assert chosen.sum() == 5


@QUICK
@given(X=unit_points(min_size=2, max_size=8), size=st.integers(1, 8))
def test_distant_subsets_have_the_wanted_size_without_repeats(X, size):
    chosen = most_distant_subset(X, size)
    assert len(chosen) == len(set(chosen.tolist())) == min(size, len(X))
