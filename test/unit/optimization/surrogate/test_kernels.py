import numpy as np
import pytest

from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL

RNG = np.random.default_rng(3)
THETA = np.log([0.3, 0.7, 1.9])
KERNELS = [MATERN52, SQUARED_EXPONENTIAL]


def test_matern_by_hand():
    # r = 1 along the first dimension: 1.9 (1 + sqrt5 + 5/3) exp(-sqrt5)
    value = MATERN52.matrix(np.array([[0.1, 0.4]]), np.array([[0.4, 0.4]]), THETA)[0, 0]
    assert value == pytest.approx(1.9 * (1 + np.sqrt(5) + 5 / 3) * np.exp(-np.sqrt(5)), rel=1e-14)


def test_squared_exponential_by_hand():
    value = SQUARED_EXPONENTIAL.matrix(np.array([[0.0, 0.0]]), np.array([[0.0, 0.7]]), THETA)[0, 0]
    assert value == pytest.approx(1.9 * np.exp(-0.5), rel=1e-14)


@pytest.mark.parametrize("kernel", KERNELS)
def test_diagonal_is_the_matrix_diagonal(kernel):
    A = RNG.random((5, 2))
    assert np.allclose(np.diag(kernel.matrix(A, A, THETA)), kernel.diagonal(A, THETA), rtol=1e-15)


@pytest.mark.parametrize("kernel", KERNELS)
def test_parameter_gradient_against_finite_differences(kernel):
    U = RNG.random((9, 2))
    W = RNG.standard_normal((9, 9))
    W = W + W.T

    def weighted_sum(theta):
        return np.sum(W * kernel.matrix(U, U, theta))

    steps = np.eye(3) * 1e-6
    numeric = [(weighted_sum(THETA + e) - weighted_sum(THETA - e)) / 2e-6 for e in steps]
    assert np.allclose(kernel.parameter_gradient(U, THETA, W), numeric, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("kernel", KERNELS)
def test_input_gradient_against_finite_differences(kernel):
    A, U, W = RNG.random((4, 2)), RNG.random((6, 2)), RNG.standard_normal((4, 6))

    def sums(points):
        return np.sum(W * kernel.matrix(points, U, THETA), axis=1)

    numeric = np.stack([(sums(A + e) - sums(A - e)) / 2e-6 for e in np.eye(2) * 1e-6], axis=1)
    assert np.allclose(kernel.input_gradient(A, U, THETA, W), numeric, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("kernel", KERNELS)
def test_spectral_features_reproduce_the_covariance(kernel):
    A = RNG.random((6, 2))
    features = kernel.sample_features(2, THETA, 200_000, np.random.default_rng(0))(A)
    # Standard error of one entry is below 1.9 / sqrt(200000) = 0.004.
    assert np.allclose(features @ features.T, kernel.matrix(A, A, THETA), atol=0.025)


def test_prior_gradient():
    prior = MATERN52.prior(2)
    _, gradient = prior.log_density_and_gradient(THETA)
    numeric = [
        (prior.log_density_and_gradient(THETA + e)[0] - prior.log_density_and_gradient(THETA - e)[0]) / 2e-6
        for e in np.eye(3) * 1e-6
    ]
    assert np.allclose(gradient, numeric, atol=1e-8)
