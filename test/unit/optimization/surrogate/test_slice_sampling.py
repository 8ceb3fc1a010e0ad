import numpy as np
import pytest
from scipy.stats import kstest, norm

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import standardize
from mebo_grasp.optimization.surrogate.hyperparameters import learn
from mebo_grasp.optimization.surrogate.marginalized import MarginalizedSurrogate
from mebo_grasp.optimization.surrogate.slice_sampling import (
    SamplingSettings,
    sample_hyperparameters,
    slice_sweep,
)


def test_slice_sampling_of_a_known_density():
    rng = np.random.default_rng(0)

    def log_density(v):
        return -0.5 * ((v[0] - 2.0) / 0.5) ** 2 - 0.5 * (v[1] / 3.0) ** 2

    state = np.array([8.0, 8.0])
    value, draws = log_density(state), []
    for _ in range(6000):
        state, value = slice_sweep(log_density, state, value, 1.5, rng)
        draws.append(state)
    thinned = np.array(draws[100::6])
    assert kstest(thinned[:, 0], norm(2.0, 0.5).cdf).pvalue > 1e-3
    assert kstest(thinned[:, 1], norm(0.0, 3.0).cdf).pvalue > 1e-3


def data(n=40):
    U = np.random.default_rng(0).random((n, 2))
    return U, np.sin(7.0 * U[:, 0]) + 0.3 * U[:, 1]


def test_draws_surround_the_most_probable_hyperparameters():
    U, y = data()
    z, _, _ = standardize(y)
    draws = sample_hyperparameters(U, z, np.random.default_rng(1), settings=SamplingSettings(n_samples=200))
    vectors = np.array([draw.vector for draw in draws])
    best = learn(U, z)[0].vector
    assert np.all(np.abs(vectors[:, :2].mean(axis=0) - best[:2]) < 1.0)
    assert np.all(vectors.std(axis=0) > 0.01)


def test_surrogate_keeps_draws_between_samplings_and_in_its_state():
    known = Observations(2)
    for u, value in zip(*data(12), strict=True):
        known.add(u, float(value))
    surrogate = MarginalizedSurrogate(2, relearn_period=2, sampling=SamplingSettings(n_samples=3, burn_in=2))
    rng = np.random.default_rng(0)
    states = []
    for _ in range(3):
        surrogate.update(known, rng)
        states.append(surrogate.state()["draws"])
    assert states[0] == states[1] != states[2]
    assert len(states[0]) == 3
    twin = MarginalizedSurrogate(2)
    twin.restore(surrogate.state())
    assert twin.state() == surrogate.state()
    for bad in ({}, {"draws": [[0.0]], "iterations_since_learning": 1}):
        with pytest.raises(RunLogError):
            twin.restore(bad)


def test_settings_are_checked():
    for bad in ({"n_samples": 0}, {"burn_in": -1}, {"width": 0.0}):
        with pytest.raises(InvalidSettingsError):
            SamplingSettings(**bad)
