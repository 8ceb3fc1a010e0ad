import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.acquisition.base import OnPosterior
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import (
    ExpectedImprovement,
    LogExpectedImprovement,
    LogProbabilityOfImprovement,
    ProbabilityOfImprovement,
    log_normalized_improvement,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess

ALL = [
    ExpectedImprovement(1.5),
    LogExpectedImprovement(1.5),
    ProbabilityOfImprovement(1.5),
    LogProbabilityOfImprovement(1.5),
    UpperConfidenceBound(2.0),
]


@pytest.mark.parametrize(("mean", "sd"), [(1.0, 0.5), (2.0, 0.3), (-1.0, 1.2), (1.5, 1.0)])
def test_expected_improvement_against_quadrature(mean, sd):
    integral, _ = quad(lambda v: (v - 1.5) * norm.pdf(v, mean, sd), 1.5, mean + 12.0 * sd, epsabs=1e-13)
    value = ExpectedImprovement(1.5).value(np.array([mean]), np.array([sd]))[0]
    assert value == pytest.approx(integral, rel=1e-8)
    log_value = LogExpectedImprovement(1.5).value(np.array([mean]), np.array([sd]))[0]
    assert log_value == pytest.approx(np.log(integral), abs=1e-8)


def test_probability_of_improvement_against_the_normal_tail():
    value = ProbabilityOfImprovement(1.5).value(np.array([1.0]), np.array([0.25]))[0]
    assert value == pytest.approx(norm.sf(1.5, 1.0, 0.25), rel=1e-12)


def test_log_improvement_far_in_the_tail():
    # Reference by the asymptotic series phi(t)/t² (1 - 3/t² + 15/t⁴ - 105/t⁶), exact to 1e-9 for |t| >= 40.
    for t in (-40.0, -1e3, -1e5, -1e8):
        series = 1.0 - 3.0 / t**2 + 15.0 / t**4 - 105.0 / t**6
        reference = -0.5 * t * t - 0.5 * np.log(2 * np.pi) - 2.0 * np.log(-t) + np.log(series)
        assert log_normalized_improvement(np.array([t]))[0] == pytest.approx(reference, rel=1e-9, abs=1e-5)


def test_log_improvement_is_smooth_where_its_formulas_meet():
    for t in (-1.0, -1e3):
        left, right = log_normalized_improvement(np.array([t * (1 + 1e-12), t * (1 - 1e-12)]))
        assert left == pytest.approx(right, abs=1e-5)


@pytest.mark.parametrize("acquisition", ALL, ids=lambda a: a.name)
def test_partials_against_finite_differences(acquisition):
    mean, sd = np.array([1.0, 2.2, -3.0]), np.array([0.5, 0.9, 0.7])
    by_mean, by_sd = acquisition.partials(mean, sd)
    h = 1e-6
    numeric_mean = (acquisition.value(mean + h, sd) - acquisition.value(mean - h, sd)) / (2 * h)
    numeric_sd = (acquisition.value(mean, sd + h) - acquisition.value(mean, sd - h)) / (2 * h)
    assert np.allclose(by_mean, numeric_mean, rtol=1e-5, atol=1e-8)
    assert np.allclose(by_sd, numeric_sd, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("acquisition", ALL, ids=lambda a: a.name)
def test_gradient_over_points_against_finite_differences(acquisition):
    U = np.random.default_rng(0).random((10, 2))
    function = OnPosterior(acquisition, GaussianProcess.fit(U, np.sin(7 * U[:, 0]) + U[:, 1]))
    A = np.random.default_rng(1).random((4, 2))
    value, gradient = function.with_gradient(A)
    assert np.allclose(value, function(A))
    numeric = np.stack([(function(A + e) - function(A - e)) / 2e-6 for e in np.eye(2) * 1e-6], axis=1)
    assert np.allclose(gradient, numeric, rtol=1e-4, atol=1e-6)


def test_upper_confidence_bound_by_hand_and_its_limits():
    assert UpperConfidenceBound(2.0).value(np.array([1.0]), np.array([0.25]))[0] == 1.5
    for beta in (-0.1, np.inf, np.nan):
        with pytest.raises(InvalidSettingsError, match="beta"):
            UpperConfidenceBound(beta)
