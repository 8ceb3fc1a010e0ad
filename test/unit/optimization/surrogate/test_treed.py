import json

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, standardize
from mebo_grasp.optimization.surrogate.hyperparameters import noise_prior
from mebo_grasp.optimization.surrogate.kernels import MATERN52
from mebo_grasp.optimization.surrogate.marginalized import MarginalizedSurrogate
from mebo_grasp.optimization.surrogate.partition import grow, path_parts, split_gains
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings
from mebo_grasp.optimization.surrogate.treed_surrogate import TreedSurrogate, TreeSettings
from mebo_grasp.optimization.surrogate.weighted_likelihood import Part, WeightedPosterior


def known(n=60, dim=2, seed=0):
    rng = np.random.default_rng(seed)
    observations = Observations(dim)
    for u in rng.random((n, dim)):
        rough = np.sin(40.0 * u[0]) if u[0] > 0.5 else 0.0
        observations.add(u, float(np.sin(3.0 * u.sum()) + rough))
    return observations


def sse(y):
    return float(np.sum((y - np.mean(y)) ** 2))


def test_gain_of_a_split_is_the_fall_of_squared_deviations_with_the_split_on_both_sides():
    y = np.random.default_rng(0).standard_normal(12) + 5.0
    expected = [sse(y) - sse(y[: i + 1]) - sse(y[i:]) for i in range(12)]
    assert split_gains(y) == pytest.approx(expected)


def test_the_first_split_is_the_best_of_all_by_brute_force():
    data = known()
    U, y, least = data.U, data.y, 8
    tree = grow(U, y, least)
    gains = {}
    for axis in range(2):
        for t in U[:, axis]:
            left, right = U[:, axis] <= t, U[:, axis] >= t
            if min(left.sum(), right.sum()) >= least and 0.01 <= t <= 0.99:
                gains[axis, t] = sse(y) - sse(y[left]) - sse(y[right])
    assert (tree.axis, tree.threshold) == max(gains, key=gains.__getitem__)


def test_leaves_cover_the_cube_once_and_keep_their_size():
    data = known(100, 3)
    tree = grow(data.U, data.y, 10)
    leaves = list(tree.leaves())
    assert len(leaves) > 3
    assert all(len(leaf.members) >= 10 for leaf in leaves)
    assert sum(np.prod(leaf.upper - leaf.lower) for leaf in leaves) == pytest.approx(1.0)
    A = np.random.default_rng(1).random((500, 3))
    for u, number in zip(A, tree.leaf_numbers(A), strict=True):
        assert np.all((u >= leaves[number].lower) & (u <= leaves[number].upper))


def test_equal_coordinates_and_equal_values_are_not_split():
    U = np.repeat([[0.3], [0.7]], 20, axis=0)
    assert grow(U, np.repeat([0.0, 1.0], 20), 2).axis == -1
    assert grow(np.linspace(0, 1, 50)[:, None], np.ones(50), 2).axis == -1


@pytest.mark.parametrize("power", [1.0, 2.0, 3.0, None])
def test_pseudo_likelihood_agrees_with_the_formula_term_by_term(power):
    data = known(80)
    tree = grow(data.U, data.y, 8)
    z = standardize(data.y)[0]
    path = max(tree.paths(), key=len)
    assert len(path) > 2
    parts = [Part(data.U[m], z[m], w) for m, w in path_parts(path, power)]
    density = WeightedPosterior(parts)
    vector = density.prior.mean + 0.3
    K = MATERN52.matrix(data.U, data.U, vector[:-1]) + np.exp(vector[-1]) * np.eye(80)
    expected = density.prior.log_density_and_gradient(vector)[0]
    counted: set[int] = set()
    for i, node in enumerate(path):
        own = np.array(sorted(set(node.members.tolist()) - counted))
        counted |= set(node.members.tolist())
        weight = (float(i == 0)) if power is None else (2.0 / (1.0 + i)) ** power
        covariance = K[np.ix_(own, own)]
        expected += weight * multivariate_normal(np.zeros(len(own)), covariance).logpdf(z[own])
    assert density(vector) == pytest.approx(expected)
    value, gradient = density.with_gradient(vector)
    assert value == pytest.approx(expected)
    for i in range(len(vector)):
        step = 1e-5 * np.eye(len(vector))[i]
        assert gradient[i] == pytest.approx((density(vector + step) - density(vector - step)) / 2e-5, rel=1e-4)


def test_one_leaf_is_the_gaussian_process():
    data = known(30)
    surrogate = TreedSurrogate(2, settings=TreeSettings(min_leaf=16, half_range_signal=False))
    treed = surrogate.update(data, np.random.default_rng(0))
    assert len(treed.leaves) == 1
    leaf = treed.leaves[0]
    assert isinstance(leaf, GaussianProcess)
    plain = GaussianProcess.fit(data.U, data.y, leaf.hyperparameters)
    A = np.random.default_rng(2).random((20, 2))
    for mine, its in zip(treed.predict_with_gradients(A), plain.predict_with_gradients(A), strict=True):
        assert mine == pytest.approx(its)
    # Its hyperparameters are a summit of the plain posterior as well.
    density = WeightedPosterior([Part(data.U, standardize(data.y)[0], 1.0)])
    vector = leaf.hyperparameters.vector
    inside = (vector > density.prior.lower) & (vector < density.prior.upper)
    assert np.abs(density.with_gradient(vector)[1][inside]).max() < 0.2


def test_one_leaf_with_sampling_is_the_sampled_gaussian_process():
    data, sampling = known(20), SamplingSettings(3, 4)
    settings = TreeSettings(16, None, sampling, half_range_signal=False)
    treed = TreedSurrogate(2, settings=settings).update(data, np.random.default_rng(7))
    plain = MarginalizedSurrogate(2, sampling=sampling).update(data, np.random.default_rng(7))
    A = np.random.default_rng(2).random((20, 2))
    for mine, its in zip(treed.predict(A), plain.predict(A), strict=True):
        assert mine == pytest.approx(its)


@pytest.mark.parametrize("sampling", [None, SamplingSettings(2, 2, 1)])
@pytest.mark.parametrize("power", [None, 1.0])
def test_predictions_gradients_and_assumed_values_are_those_of_the_leaves(sampling, power):
    data = known(60)
    # With noise, a draw would not pass through the values that are assumed below.
    surrogate = TreedSurrogate(2, settings=TreeSettings(12, power, sampling), noise=noise_prior(1e-6))
    treed = surrogate.update(data, np.random.default_rng(0))
    assert len(treed.leaves) > 2
    A = np.random.default_rng(3).random((40, 2))
    numbers = treed.tree.leaf_numbers(A)
    mean, sd, d_mean, d_sd = treed.predict_with_gradients(A)
    assert np.concatenate([mean, sd]) == pytest.approx(np.concatenate(treed.predict(A)), rel=1e-6)
    assert mean == pytest.approx(treed.predict_mean(A))
    assert d_mean == pytest.approx(treed.mean_gradient(A))
    single = [treed.predict_with_gradients(A[i : i + 1]) for i in range(len(A))]
    for many, one_by_one in zip((mean, sd, d_mean, d_sd), zip(*single, strict=True), strict=True):
        assert many == pytest.approx(np.concatenate(one_by_one), rel=1e-6)
    for i in (0, 5, 11):
        leaf = treed.leaves[numbers[i]]
        assert [mean[i], sd[i]] == pytest.approx(np.ravel(leaf.predict(A[i : i + 1])), rel=1e-6)
        assert d_sd[i] == pytest.approx(leaf.predict_with_gradients(A[i : i + 1])[3][0], rel=1e-6)
    more = treed.condition_on(A[:3], np.array([9.0, 9.0, 9.0]))
    assert more.n == 63
    assert np.all(more.predict(A[:3])[1] < 0.2 * sd[:3])
    assert np.isfinite(treed.noise_sd)
    assert treed.lengthscales.shape == (2,)


def test_a_path_passes_through_the_observations():
    data = known(60)
    treed = TreedSurrogate(2, settings=TreeSettings(12)).update(data, np.random.default_rng(0))
    assert treed.sample_path(np.random.default_rng(1))(data.U) == pytest.approx(data.y, abs=0.2)


def test_regions_differ_in_smoothness_where_the_function_does():
    rng = np.random.default_rng(0)
    data = Observations(1)
    for u in np.sort(rng.random((80, 1)), axis=0):
        data.add(u, float(3.0 + np.sin(60.0 * u[0])) if u[0] > 0.6 else float(u[0]))
    treed = TreedSurrogate(1, settings=TreeSettings(15)).update(data, rng)
    scales = [leaf.lengthscales[0] for leaf in treed.leaves]
    assert scales[0] > 3.0 * scales[-1]
    grid = np.linspace(0.62, 0.98, 50)[:, None]
    assert np.mean(np.abs(treed.predict_mean(grid) - 3.0 - np.sin(60.0 * grid[:, 0]))) < 0.3


@pytest.mark.parametrize("sampling", [None, SamplingSettings(2, 2, 1)])
def test_the_signal_of_every_leaf_is_half_the_range_of_all_values(sampling):
    data = known(60)
    treed = TreedSurrogate(2, settings=TreeSettings(12, None, sampling)).update(data, np.random.default_rng(0))
    members: list[GaussianProcess] = []
    for leaf in treed.leaves:
        members += [leaf] if isinstance(leaf, GaussianProcess) else leaf.members
    signals = [member.scale * np.exp(0.5 * member.hyperparameters.theta[-1]) for member in members]
    assert signals == pytest.approx([0.5 * np.ptp(data.y)] * len(members))


def test_new_observations_join_their_leaves_and_a_restored_surrogate_is_the_same():
    data = known(60)
    surrogate = TreedSurrogate(2, relearn_period=3, settings=TreeSettings(12, 2.0))
    surrogate.update(data, np.random.default_rng(0))
    data.add([0.123, 0.456], 7.0)
    twin = TreedSurrogate(2, relearn_period=3, settings=TreeSettings(12, 2.0))
    twin.restore(json.loads(json.dumps(surrogate.state())))
    A = np.random.default_rng(2).random((20, 2))
    assert surrogate.posterior(data).predict_mean(np.array([[0.123, 0.456]]))[0] == pytest.approx(7.0, abs=0.5)
    for _ in range(4):
        mine = surrogate.update(data, np.random.default_rng(1)).predict(A)
        assert np.array_equal(mine, twin.update(data, np.random.default_rng(1)).predict(A))
        data.add(np.random.default_rng(data.n).random(2), 1.0)


def test_bad_states_and_settings_are_refused():
    surrogate = TreedSurrogate(2)
    state = surrogate.state()
    for bad in ({}, {**state, "leaves": []}, {**state, "leaves": [[[0.0]]]}, {**state, "n_grown": -1}):
        with pytest.raises(RunLogError):
            surrogate.restore(bad)
    with pytest.raises(InvalidSettingsError, match="2 observations"):
        TreeSettings(min_leaf=1)
    with pytest.raises(InvalidSettingsError, match="power"):
        TreeSettings(weight_power=-1.0)
