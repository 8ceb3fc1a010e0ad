from itertools import pairwise

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.empirical_bayes import EmpiricalBayesSurrogate
from mebo_grasp.optimization.surrogate.gaussian_process import Hyperparameters
from mebo_grasp.optimization.surrogate.hyperparameters import (
    LearningSettings,
    full_prior,
    learn,
    log_posterior_and_gradient,
    subset,
)
from mebo_grasp.optimization.surrogate.kernels import MATERN52


def draw_from_model(true, n=150, dim=2, seed=0):
    rng = np.random.default_rng(seed)
    U = rng.random((n, dim))
    K = MATERN52.matrix(U, U, true.theta) + np.exp(true.log_noise) * np.eye(n)
    return U, np.linalg.cholesky(K) @ rng.standard_normal(n)


def test_finds_the_lengthscales_and_noise_the_data_came_from():
    true = Hyperparameters(np.log([0.08, 0.6, 1.0]), float(np.log(1e-2)))
    U, z = draw_from_model(true)
    learned, _ = learn(U, z)
    assert np.allclose(learned.vector, true.vector, atol=0.7)


def test_result_is_a_stationary_point_of_the_posterior():
    true = Hyperparameters(np.log([0.2, 0.4, 1.0]), float(np.log(1e-3)))
    U, z = draw_from_model(true, 60)
    learned, value = learn(U, z, settings=LearningSettings(max_iterations=200))
    prior = full_prior(2, MATERN52)
    again, gradient = log_posterior_and_gradient(learned.vector, U, z, MATERN52, prior)
    assert again == pytest.approx(value)
    assert np.max(np.abs(gradient)) < 0.05


def test_irrelevant_dimension_gets_a_long_lengthscale():
    rng = np.random.default_rng(1)
    U = rng.random((80, 2))
    learned, _ = learn(U, np.sin(12.0 * U[:, 0]))
    assert learned.theta[1] > learned.theta[0] + 1.5


def test_subset_keeps_the_best_and_the_wanted_number():
    z = np.random.default_rng(0).standard_normal(1000)
    mask = subset(z, 100, np.random.default_rng(1))
    assert mask.sum() == 100
    assert mask[np.argsort(z)[-10:]].all()
    assert subset(z, 1000, np.random.default_rng(1)).all()


def observations_of(f, n, seed=0):
    known = Observations(2)
    for u in np.random.default_rng(seed).random((n, 2)):
        known.add(u, float(f(u)))
    return known


def test_surrogate_relearns_when_the_period_has_passed():
    known = observations_of(lambda u: np.sin(9 * u[0]), 20)
    surrogate = EmpiricalBayesSurrogate(2, relearn_period=3)
    rng = np.random.default_rng(0)
    vectors = []
    for i in range(7):
        surrogate.update(known, rng)
        vectors.append(surrogate.hyperparameters.vector)
        known.add([0.1 * i, 0.9], float(np.sin(0.9 * i)))
    changed = [not np.array_equal(a, b) for a, b in pairwise(vectors)]
    assert changed == [False, False, True, False, False, True]


@pytest.mark.parametrize("value", [0.0, 2.5])
def test_surrogate_keeps_the_prior_while_all_values_are_equal(value):
    surrogate = EmpiricalBayesSurrogate(2)
    known = observations_of(lambda _: value, 8)
    gp = surrogate.update(known, np.random.default_rng(0))
    assert np.array_equal(surrogate.hyperparameters.vector, Hyperparameters.default(2).vector)
    known.add([0.5, 0.5], value + 1.0)
    surrogate.update(known, np.random.default_rng(0))
    assert not np.array_equal(surrogate.hyperparameters.vector, Hyperparameters.default(2).vector)
    assert np.all(gp.predict(np.array([[0.1, 0.1]]))[0] == value)


def test_state_round_trip_and_refusal():
    surrogate = EmpiricalBayesSurrogate(2)
    surrogate.update(observations_of(lambda u: u[0], 9), np.random.default_rng(0))
    twin = EmpiricalBayesSurrogate(2)
    twin.restore(surrogate.state())
    assert twin.state() == surrogate.state()
    for bad in ({}, {"vector": [0.0], "iterations_since_learning": 1}, {"vector": "x"}):
        with pytest.raises(RunLogError):
            twin.restore(bad)


def test_settings_are_checked():
    with pytest.raises(InvalidSettingsError):
        LearningSettings(max_iterations=0)
    with pytest.raises(InvalidSettingsError):
        EmpiricalBayesSurrogate(1, relearn_period=0)
