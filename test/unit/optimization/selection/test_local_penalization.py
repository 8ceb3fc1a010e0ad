import numpy as np
import pytest
from scipy.special import erfc

from mebo_grasp.optimization.selection.local_penalization import (
    FLAT_LIPSCHITZ,
    RESOLUTION,
    LocalPenalizer,
    lipschitz_constant,
    log_softplus,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters


def posterior():
    U = np.linspace(0.0, 1.0, 25)[:, None]
    hyper = Hyperparameters(np.log([0.3, 1.0]), float(np.log(1e-8)))
    return GaussianProcess.fit(U, np.sin(2.0 * np.pi * U[:, 0]), hyper)


def test_lipschitz_constant_of_a_sine():
    assert lipschitz_constant(posterior(), np.random.default_rng(0)) == pytest.approx(2.0 * np.pi, rel=0.01)


def test_lipschitz_constant_of_a_plateau_is_assumed():
    flat = GaussianProcess.fit(np.random.default_rng(0).random((5, 2)), np.zeros(5))
    assert lipschitz_constant(flat, np.random.default_rng(0)) == FLAT_LIPSCHITZ


def test_penalty_by_its_formula():
    gp = posterior()
    penalizer = LocalPenalizer(gp, maximum=1.0, lipschitz=6.0)
    centre = np.array([[0.6]])
    penalizer.add(centre)
    mean, sd = gp.predict(centre)
    spread = np.sqrt(sd**2 + gp.noise_sd**2 + (RESOLUTION * gp.scale) ** 2)
    A = np.array([[0.6], [0.7], [0.95]])
    z = (6.0 * np.abs(A[:, 0] - 0.6) - 1.0 + mean) / (np.sqrt(2.0) * spread)
    assert np.allclose(np.exp(penalizer(A)), 0.5 * erfc(-z))


def test_penalties_multiply_and_none_means_no_penalty():
    penalizer = LocalPenalizer(posterior(), 1.0, 6.0)
    A = np.array([[0.1], [0.8]])
    assert np.array_equal(penalizer(A), np.zeros(2))
    penalizer.add(np.array([[0.5]]))
    once = penalizer(A)
    penalizer.add(np.array([[0.5]]))
    assert np.allclose(penalizer(A), 2.0 * once)
    assert np.all(once < 0.0)


def test_log_softplus_far_out_on_both_sides():
    values = np.array([-800.0, -30.5, 0.0, 800.0])
    assert np.allclose(log_softplus(values), [-800.0, -30.5, np.log(np.log(2.0)), np.log(800.0)])
