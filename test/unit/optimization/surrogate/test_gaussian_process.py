import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.surrogate.gaussian_process import (
    GaussianProcess,
    Hyperparameters,
    cholesky,
    log_marginal_likelihood_and_gradient,
    standardize,
)
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL

LENGTHSCALES, SIGNAL, NOISE = np.array([0.3, 0.6, 0.2]), 1.7, 1e-3
HYPER = Hyperparameters(np.log([*LENGTHSCALES, SIGNAL]), float(np.log(NOISE)))
PAIRS = [(MATERN52, Matern(LENGTHSCALES, nu=2.5)), (SQUARED_EXPONENTIAL, RBF(LENGTHSCALES))]


def data(n=40, seed=0):
    rng = np.random.default_rng(seed)
    U = rng.random((n, 3))
    return U, 50.0 + 8.0 * np.sin(6.0 * U[:, 0]) + U[:, 1] ** 2 - 3.0 * np.cos(9.0 * U[:, 2])


def test_two_points_by_hand():
    # y = 3 and 7: centre 5, scale 2, z = -1, 1. With k = K12 and s = 1 + noise the weights are ±1/(s - k).
    hyper = Hyperparameters(np.log([0.5, 1.0]), float(np.log(0.01)))
    gp = GaussianProcess.fit(np.array([[0.2], [0.6]]), np.array([3.0, 7.0]), hyper, SQUARED_EXPONENTIAL)
    k = np.exp(-0.5 * 0.8**2)
    a, b = np.exp(-0.5 * 0.2**2), np.exp(-0.5 * 0.6**2)  # covariances of u = 0.3 with the two
    s = 1.01
    mean = 5.0 + 2.0 * (b - a) / (s - k)
    variance = 1.0 - (s * a * a - 2.0 * k * a * b + s * b * b) / (s * s - k * k)
    got_mean, got_sd = gp.predict(np.array([[0.3]]))
    assert got_mean[0] == pytest.approx(mean, rel=1e-12)
    assert got_sd[0] == pytest.approx(2.0 * np.sqrt(variance), rel=1e-12)
    evidence = -0.5 * 2.0 / (s - k) - 0.5 * np.log(s * s - k * k) - np.log(2.0 * np.pi)
    assert gp.log_marginal_likelihood() == pytest.approx(evidence, rel=1e-12)


@pytest.mark.parametrize(("kernel", "reference"), PAIRS)
def test_posterior_and_evidence_agree_with_scikit_learn(kernel, reference):
    U, y = data()
    A = np.random.default_rng(9).random((1200, 3))  # more than two chunks
    theirs = GaussianProcessRegressor(
        ConstantKernel(SIGNAL) * reference, alpha=NOISE, optimizer=None, normalize_y=True
    ).fit(U, y)
    mean, sd = theirs.predict(A, return_std=True)
    gp = GaussianProcess.fit(U, y, HYPER, kernel)
    got_mean, got_sd = gp.predict(A)
    assert np.allclose(got_mean, mean, rtol=1e-9)
    assert np.allclose(got_sd, sd, rtol=1e-6)
    assert np.allclose(gp.predict_mean(A), mean, rtol=1e-9)
    assert gp.log_marginal_likelihood() == pytest.approx(theirs.log_marginal_likelihood_value_, rel=1e-9)


@pytest.mark.parametrize("kernel", [MATERN52, SQUARED_EXPONENTIAL])
def test_evidence_gradient_against_finite_differences(kernel):
    U, y = data()
    z, _, _ = standardize(y)
    value, gradient = log_marginal_likelihood_and_gradient(U, z, HYPER, kernel)
    fitted = GaussianProcess.fit(U, y, HYPER, kernel)
    assert value == pytest.approx(fitted.log_marginal_likelihood(), rel=1e-12)

    def evidence(vector):
        return log_marginal_likelihood_and_gradient(U, z, Hyperparameters.from_vector(vector), kernel)[0]

    numeric = [(evidence(HYPER.vector + e) - evidence(HYPER.vector - e)) / 2e-5 for e in np.eye(5) * 1e-5]
    assert np.allclose(gradient, numeric, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("kernel", [MATERN52, SQUARED_EXPONENTIAL])
def test_posterior_gradients_against_finite_differences(kernel):
    U, y = data()
    gp = GaussianProcess.fit(U, y, HYPER, kernel)
    A = np.random.default_rng(2).random((5, 3))
    mean, sd, d_mean, d_sd = gp.predict_with_gradients(A)
    steps = np.eye(3) * 1e-6
    for i, gradient in ((0, d_mean), (1, d_sd)):
        numeric = [(gp.predict(A + e)[i] - gp.predict(A - e)[i]) / 2e-6 for e in steps]
        assert np.allclose(gradient, np.transpose(numeric), rtol=1e-4, atol=1e-4)
    assert np.allclose(gp.mean_gradient(A), d_mean)
    assert np.allclose((mean, sd), gp.predict(A))


def test_conditioning_equals_fitting_on_all_data_at_once():
    U, y = data()
    gp = GaussianProcess.fit(U[:30], y[:30], HYPER)
    grown = gp.condition_on(U[30:], y[30:])
    # Standardization stays that of the first 30, so the reference uses it as well.
    K = MATERN52.matrix(U, U, HYPER.theta) + NOISE * np.eye(40)
    A = np.random.default_rng(6).random((7, 3))
    k = MATERN52.matrix(A, U, HYPER.theta)
    mean, sd = grown.predict(A)
    assert mean == pytest.approx(gp.centre + gp.scale * (k @ np.linalg.solve(K, (y - gp.centre) / gp.scale)), rel=1e-9)
    explained = np.einsum("ij,ji->i", k, np.linalg.solve(K, k.T))
    assert sd == pytest.approx(gp.scale * np.sqrt(SIGNAL - explained), rel=1e-6)


def test_paths_have_the_posteriors_moments():
    U, y = data(12)
    gp = GaussianProcess.fit(U, y, HYPER)
    A = np.random.default_rng(4).random((6, 3))
    rng = np.random.default_rng(0)
    draws = np.array([gp.sample_path(rng, 512)(A) for _ in range(3000)])
    mean, sd = gp.predict(A)
    assert np.all(np.abs(draws.mean(0) - mean) < 4.5 * sd / np.sqrt(3000))
    assert np.allclose(draws.std(0), sd, rtol=0.1)


@pytest.mark.parametrize("noise", [1e-2, 1e-9])
def test_at_the_observed_points_it_is_what_is_predicted_there(noise):
    U, y = data()
    gp = GaussianProcess.fit(U, y, Hyperparameters(HYPER.theta, float(np.log(noise))))
    for got, expected in zip(gp.predict_observed(), gp.predict(U), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_a_jitter_counts_as_noise_at_the_observed_points():
    U, y = np.array([[0.3], [0.3], [0.8]]), np.array([1.0, 1.0, 2.0])
    hyper = Hyperparameters(np.log([0.5, 1.0]), -80.0)
    gp = GaussianProcess.fit(U, y, hyper, SQUARED_EXPONENTIAL)
    assert gp.L[0, 0] > 1.0  # singular without one
    np.testing.assert_allclose(gp.predict_observed()[0], gp.predict(U)[0], atol=1e-6)
    assert np.all(gp.predict_observed()[1] > 0.0)


def test_no_data_gives_the_prior():
    gp = GaussianProcess.fit(np.empty((0, 2)), np.empty(0))
    mean, sd = gp.predict(np.array([[0.3, 0.4]]))
    assert (mean[0], sd[0]) == (0.0, 1.0)
    assert np.isfinite(gp.sample_path(np.random.default_rng(0))(np.array([[0.3, 0.4]]))).all()


@pytest.mark.parametrize("value", [0.0, -3.5, 1e300])
def test_equal_values_and_duplicates_do_not_break_it(value):
    U = np.repeat([[0.2], [0.8]], 10, axis=0)
    gp = GaussianProcess.fit(U, np.full(20, value))
    mean, sd = gp.predict(np.linspace(0, 1, 7)[:, None])
    assert np.all(mean == value)
    assert np.all(np.isfinite(sd) & (sd > 0.0))


def test_standard_deviation_stays_positive_at_the_data():
    U, y = data(200)
    hyper = Hyperparameters(HYPER.theta, float(np.log(1e-12)))
    _, sd = GaussianProcess.fit(U, y, hyper).predict(U)
    assert np.all(sd > 0.0)


def test_cholesky_mends_rounding_and_refuses_nonsense():
    singular = np.ones((3, 3))
    L = cholesky(singular)
    assert np.allclose(L @ L.T, singular, atol=1e-6)
    with pytest.raises(InvalidSettingsError, match="not positive definite"):
        cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))


@pytest.mark.parametrize(
    ("U", "y"),
    [(np.zeros((2, 1)), np.zeros(3)), (np.zeros(2), np.zeros(2)), (np.zeros((1, 1)), np.array([np.nan]))],
)
def test_bad_data_is_refused(U, y):
    with pytest.raises(InvalidSettingsError, match="finite U"):
        GaussianProcess.fit(U, y)


@pytest.mark.parametrize("count", [1, 4])
def test_a_conditioned_posterior_is_the_same_whether_or_not_variances_were_asked_for_before(count):
    rng = np.random.default_rng(3)
    U, A, new = rng.random((30, 3)), rng.random((20, 3)), rng.random((count, 3))
    y, values = np.sin(5.0 * U[:, 0]) + U[:, 1], rng.standard_normal(count)
    asked, fresh = GaussianProcess.fit(U, y), GaussianProcess.fit(U, y)
    asked.predict(A)
    for _ in range(2):
        asked, fresh = asked.condition_on(new, values), fresh.condition_on(new, values)
        np.testing.assert_allclose(asked.predict(A), fresh.predict(A), rtol=1e-9, atol=1e-9)
        new = new + 0.01


def test_many_points_are_predicted_like_few():
    U = np.random.default_rng(0).random((12, 2))
    gp = GaussianProcess.fit(U, np.sin(U[:, 0]))
    A = np.random.default_rng(1).random((1300, 2))
    np.testing.assert_allclose(gp.predict_mean(A), [gp.predict_mean(a[None])[0] for a in A], rtol=1e-12)
