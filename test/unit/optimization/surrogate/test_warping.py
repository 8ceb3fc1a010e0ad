"""Input maps: truths by closed form and by central differences."""

import numpy as np
import pytest

from mebo_grasp.optimization.surrogate.additive import (
    ADDITIVE_MATERN52,
    ADDITIVE_SQUARED_EXPONENTIAL,
    SumKernel,
)
from mebo_grasp.optimization.surrogate.gaussian_process import (
    GaussianProcess,
    Hyperparameters,
    log_marginal_likelihood_and_gradient,
)
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel, StretchWarp, Turn

WARP, STRETCH, TURN = KumaraswamyWarp(), StretchWarp(), Turn()
KERNELS = [
    ADDITIVE_MATERN52,
    ADDITIVE_SQUARED_EXPONENTIAL,
    SumKernel(ADDITIVE_SQUARED_EXPONENTIAL, MATERN52),
    MappedKernel(MATERN52, WARP),
    MappedKernel(SQUARED_EXPONENTIAL, TURN),
    MappedKernel(MappedKernel(ADDITIVE_MATERN52, WARP), TURN),
    MappedKernel(MappedKernel(ADDITIVE_MATERN52, STRETCH), TURN),
]


def differences(function, point, step=1e-5):
    """Central differences of a scalar function of a vector."""
    result = np.empty(len(point))
    for i in range(len(point)):
        ahead, behind = point.copy(), point.copy()
        ahead[i] += step
        behind[i] -= step
        result[i] = (function(ahead) - function(behind)) / (2.0 * step)
    return result


def test_warp_is_the_identity_at_its_priors_mean_but_for_the_border():
    U = np.linspace(0.0, 1.0, 11)[:, None]
    np.testing.assert_allclose(WARP.forward(U, WARP.prior(1).mean), U, atol=1.01e-4)


def test_warp_has_its_closed_form():
    # a = 2, b = 3 at u = 0.5: 1 - (1 - 0.25)^3 = 0.578125; the drawing-in moves 0.5 nowhere.
    assert WARP.forward(np.array([[0.5]]), np.log([2.0, 3.0]))[0, 0] == pytest.approx(0.578125, abs=1e-12)


@pytest.mark.parametrize("phi", [(0.0, 0.0), (-2.0, 1.5), (2.0, -2.0), (-2.5, -2.5), (1.0, 2.5)])
def test_warp_rises_and_is_undone_by_its_inverse(phi):
    phi = np.array(phi)
    U = np.linspace(0.0, 1.0, 101)[:, None]
    warped = WARP.forward(U, phi)
    assert np.all(np.diff(warped[:, 0]) >= 0.0)
    assert warped.min() >= 0.0
    assert warped.max() <= 1.0
    # Where the warp is flat to machine precision the inverse cannot know; elsewhere it must.
    slope = np.gradient(warped[:, 0], U[:, 0])
    sure = slope > 1e-4
    assert sure.sum() > 10
    np.testing.assert_allclose(WARP.inverse(warped, phi)[sure], U[sure], atol=1e-5)


def test_stretch_has_its_closed_form():
    # c = 0.5, s = 0.1 at u = 0.8: (asinh 3 + asinh 5) / (2 asinh 5), with asinh x = log(x + sqrt(x² + 1)).
    near, far = np.log(3.0 + np.sqrt(10.0)), np.log(5.0 + np.sqrt(26.0))
    stretched = STRETCH.forward(np.array([[0.8]]), np.array([0.5, np.log(0.1)]))
    assert stretched[0, 0] == pytest.approx(0.5 * (near + far) / far, abs=1e-12)


def test_wide_stretch_changes_next_to_nothing():
    U = np.random.default_rng(5).random((20, 2))
    np.testing.assert_allclose(STRETCH.forward(U, STRETCH.identity(2)), U, atol=2e-3)


@pytest.mark.parametrize("phi", [(0.5, -1.0), (0.8, -5.0), (-0.2, -3.0), (1.2, -5.8), (0.0, 2.3)])
def test_stretch_rises_from_0_to_1_and_is_undone_by_its_inverse(phi):
    U = np.linspace(0.0, 1.0, 101)[:, None]
    stretched = STRETCH.forward(U, np.array(phi))
    assert np.all(np.diff(stretched[:, 0]) > 0.0)
    np.testing.assert_allclose(stretched[[0, -1], 0], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(STRETCH.inverse(stretched, np.array(phi)), U, atol=1e-9)


@pytest.mark.parametrize("input_map", [WARP, STRETCH, TURN], ids=["warp", "stretch", "turn"])
def test_gradients_of_a_map_match_differences(input_map):
    rng = np.random.default_rng(1)
    U, G = 0.05 + 0.9 * rng.random((6, 2)), rng.standard_normal((6, 2))
    phi = input_map.prior(2).mean + 0.4 * rng.standard_normal(len(input_map.prior(2).mean))
    by_phi = differences(lambda p: np.sum(G * input_map.forward(U, p)), phi)
    np.testing.assert_allclose(input_map.parameter_gradient(U, phi, G), by_phi, rtol=1e-6, atol=1e-8)
    by_u = differences(lambda u: np.sum(G * input_map.forward(u.reshape(6, 2), phi)), U.ravel())
    np.testing.assert_allclose(input_map.pull_back(U, phi, G).ravel(), by_u, rtol=1e-6, atol=1e-8)


def test_turn_keeps_distances_up_to_its_scale_and_is_undone():
    U = np.random.default_rng(2).random((8, 2))
    phi = np.array([0.7])
    turned = TURN.forward(U, phi)
    assert np.all((turned >= 0.0) & (turned <= 1.0))
    lengths = np.linalg.norm(np.diff(turned, axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(U, axis=0), axis=1) / np.sqrt(2.0))
    np.testing.assert_allclose(TURN.inverse(turned, phi), U, atol=1e-12)


def test_turn_refuses_other_dimensions():
    with pytest.raises(ValueError, match="2 dimensions, got 3"):
        TURN.prior(3)


def test_additive_kernel_is_the_sum_of_one_dimensional_ones():
    rng = np.random.default_rng(3)
    A, U = rng.random((4, 3)), rng.random((5, 3))
    theta = np.log([0.3, 0.7, 2.0, 0.5, 1.5, 0.1])
    expected = sum(MATERN52.matrix(A[:, [q]], U[:, [q]], np.array([theta[q], theta[3 + q]])) for q in range(3))
    np.testing.assert_allclose(ADDITIVE_MATERN52.matrix(A, U, theta), expected, rtol=1e-12)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
def test_gradients_of_a_kernel_match_differences(kernel):
    rng = np.random.default_rng(4)
    U = rng.random((20, 2))
    z = np.sin(6.0 * U[:, 0]) + U[:, 1]
    z = (z - z.mean()) / z.std()
    prior = kernel.prior(2)
    vector = np.append(prior.mean + 0.2 * rng.standard_normal(len(prior.mean)), np.log(1e-3))

    def evidence(v):
        return log_marginal_likelihood_and_gradient(U, z, Hyperparameters.from_vector(v), kernel)

    np.testing.assert_allclose(evidence(vector)[1], differences(lambda v: evidence(v)[0], vector), rtol=1e-4, atol=1e-4)
    posterior = GaussianProcess.fit(U, z, Hyperparameters.from_vector(vector), kernel)
    point = np.array([0.37, 0.61])
    _, _, d_mean, d_sd = posterior.predict_with_gradients(point[None])
    by_mean = differences(lambda u: posterior.predict(u[None])[0][0], point)
    by_sd = differences(lambda u: posterior.predict(u[None])[1][0], point)
    np.testing.assert_allclose(d_mean[0], by_mean, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(d_sd[0], by_sd, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
def test_random_features_reproduce_the_kernel(kernel):
    rng = np.random.default_rng(5)
    U, theta = rng.random((4, 2)), kernel.prior(2).mean
    features = kernel.sample_features(2, theta, 200_000, rng)(U)
    np.testing.assert_allclose(features @ features.T, kernel.matrix(U, U, theta), atol=0.02)
