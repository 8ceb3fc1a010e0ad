import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.acquisition.maximizer import (
    MaximizerSettings,
    NumericGradient,
    climb,
    maximize,
)
from mebo_grasp.optimization.acquisition.thompson import thompson
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess

ZERO, ONE = np.zeros(2), np.ones(2)


def bumps(A):
    """Two narrow bumps; the higher one at (0.83, 0.21)."""
    first = 1.0 * np.exp(-np.sum((A - [0.2, 0.7]) ** 2, axis=1) / 0.005)
    return first + 1.3 * np.exp(-np.sum((A - [0.83, 0.21]) ** 2, axis=1) / 0.005)


def test_numeric_gradient_of_a_known_function():
    function = NumericGradient(lambda A: A[:, 0] ** 2 + 3.0 * A[:, 1])
    value, gradient = function.with_gradient(np.array([[0.5, 0.1], [0.2, 0.9]]))
    assert np.allclose(value, [0.55, 2.74])
    assert np.allclose(gradient, [[1.0, 3.0], [0.4, 3.0]], atol=1e-8)


@pytest.mark.parametrize("direct", [0, 100])
def test_finds_the_higher_of_two_narrow_bumps(direct):
    settings = MaximizerSettings(direct_evaluations=direct)
    point, value = maximize(NumericGradient(bumps), ZERO, ONE, np.random.default_rng(0), settings)
    assert np.allclose(point, [0.83, 0.21], atol=1e-4)
    assert value == pytest.approx(1.3, abs=1e-6)


def test_stays_in_its_box_and_reaches_a_maximum_on_the_border():
    lower, upper = np.array([0.1, 0.2]), np.array([0.4, 0.3])
    point, _ = maximize(NumericGradient(lambda A: A.sum(axis=1)), lower, upper, np.random.default_rng(0))
    assert np.allclose(point, upper)


def test_candidates_rescue_a_needle_that_no_net_hits():
    needle = np.array([0.123456, 0.654321])

    def worth(A):
        return np.exp(-np.sum((A - needle) ** 2, axis=1) / 1e-8)

    settings = MaximizerSettings(direct_evaluations=0)
    point, value = maximize(
        NumericGradient(worth), ZERO, ONE, np.random.default_rng(0), settings, (needle + 1e-5)[None]
    )
    assert value > 0.9
    assert np.allclose(point, needle, atol=1e-4)


def test_worths_of_minus_infinity_do_not_stop_it():
    def worth(A):
        with np.errstate(divide="ignore"):
            return np.log(np.maximum(0.0, bumps(A) - 0.5))

    _, value = maximize(NumericGradient(worth), ZERO, ONE, np.random.default_rng(0))
    assert value == pytest.approx(np.log(0.8), abs=1e-3)


def test_climb_reaches_the_nearest_summit():
    point, value = climb(NumericGradient(bumps), np.array([0.25, 0.68]), ZERO, ONE)
    assert np.allclose(point, [0.2, 0.7], atol=1e-4)
    assert value == pytest.approx(1.0, abs=1e-6)


def test_thompson_draws_differ_but_agree_at_the_observations():
    U = np.random.default_rng(0).random((8, 2))
    posterior = GaussianProcess.fit(U, np.sin(5 * U[:, 0]))
    first, second = (thompson(posterior, np.random.default_rng(seed)) for seed in (1, 2))
    assert np.allclose(first(U), second(U), atol=0.1)
    away = np.random.default_rng(3).random((20, 2))
    assert np.max(np.abs(first(away) - second(away))) > 0.1


def test_settings_are_checked():
    for bad in ({"direct_evaluations": -1}, {"direct_evaluations": 0, "net_evaluations": 0}):
        with pytest.raises(InvalidSettingsError):
            MaximizerSettings(**bad)
