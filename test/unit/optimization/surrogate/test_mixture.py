"""Mixtures of Gaussian processes: of hyperparameters, and of structures that have different ones."""

import numpy as np
import pytest

from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.additive import ADDITIVE_MATERN52
from mebo_grasp.optimization.surrogate.evidence import EvidenceSurrogate
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel


def data(n=15):
    U = np.random.default_rng(0).random((n, 2))
    return U, np.sin(7.0 * U[:, 0]) + 0.3 * U[:, 1]


def of_draws():
    U, y = data()
    vectors = ([-1.0, 0.0, 0.0, -9.0], [-2.0, -1.0, 0.5, -7.0])
    return MixtureProcess.equal([GaussianProcess.fit(U, y, Hyperparameters.from_vector(np.array(v))) for v in vectors])


def of_structures():
    U, y = data()
    warped = MappedKernel(MATERN52, KumaraswamyWarp())
    vectors: dict[Kernel, list[float]] = {
        ADDITIVE_MATERN52: [-1.0, 0.0, 0.0, -0.5, -8.0],
        warped: [-1.5, -0.5, 0.3, 0.4, -0.3, 0.2, 0.1, -7.0],
    }
    members = [
        GaussianProcess.fit(U, y, Hyperparameters.from_vector(np.array(v)), kernel) for kernel, v in vectors.items()
    ]
    return MixtureProcess(tuple(members), np.array([0.8, 0.2]))


MIXTURES = pytest.mark.parametrize("make", [of_draws, of_structures])


@MIXTURES
def test_moments_are_those_of_draws_from_it(make):
    gp, A = make(), np.array([[0.3, 0.9], [0.8, 0.1]])
    rng = np.random.default_rng(2)
    draws = np.array([gp.sample_path(rng, 256)(A) for _ in range(3000)])
    mean, sd = gp.predict(A)
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 4.5 * sd / np.sqrt(3000))
    assert np.allclose(draws.std(axis=0), sd, rtol=0.1)


@MIXTURES
def test_gradients_against_finite_differences(make):
    gp, A = make(), 0.1 + 0.8 * np.random.default_rng(3).random((4, 2))
    mean, sd, d_mean, d_sd = gp.predict_with_gradients(A)
    steps = np.eye(2) * 1e-6
    for i, gradient in ((0, d_mean), (1, d_sd)):
        numeric = [(gp.predict(A + e)[i] - gp.predict(A - e)[i]) / 2e-6 for e in steps]
        assert np.allclose(gradient, np.transpose(numeric), rtol=1e-4, atol=1e-5)
    assert np.allclose((mean, sd), gp.predict(A))
    assert np.allclose(gp.mean_gradient(A), d_mean)
    assert np.allclose(gp.predict_mean(A), mean)


@MIXTURES
def test_an_assumed_value_is_believed_by_every_member(make):
    gp, A = make(), np.array([[0.5, 0.5]])
    before, spread = gp.predict(A)
    value = before + spread
    mean, sd = gp.condition_on(A, value).predict(A)
    assert abs(mean[0] - value[0]) < 0.1 * spread[0]
    assert sd[0] < 0.3 * spread[0]


def test_a_share_of_one_is_that_member_alone():
    gp, A = of_structures(), np.random.default_rng(1).random((5, 2))
    alone = MixtureProcess(gp.members, np.array([0.0, 1.0]))
    assert np.allclose(alone.predict(A), gp.members[1].predict(A))
    assert np.allclose(alone.lengthscales, gp.members[1].lengthscales)
    # exp(-1.0), exp(-1.5): the geometric mean by shares 0.8 and 0.2.
    assert gp.lengthscales[0] == pytest.approx(np.exp(-1.1))


def test_evidence_sees_that_a_function_is_additive_where_one_kernel_does_not():
    def target(U):
        return np.sin(18.0 * U[:, 0]) + np.cos(15.0 * U[:, 1])

    rng = np.random.default_rng(4)
    known = Observations(2)
    for u in rng.random((40, 2)):
        known.add(u, float(target(u[None])[0]))
    A = rng.random((200, 2))
    by_evidence = EvidenceSurrogate(2).update(known, np.random.default_rng(0))
    assert np.sqrt(np.mean((by_evidence.predict_mean(A) - target(A)) ** 2)) < 0.05
    plain = GaussianProcess.fit(known.U, known.y)
    assert np.sqrt(np.mean((plain.predict_mean(A) - target(A)) ** 2)) > 0.3
