"""Descent by a full BFGS in a box, against known minima and a second method."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from mebo_grasp.optimization.initial_design import latin_hypercube
from mebo_grasp.optimization.surrogate import bounded_bfgs
from mebo_grasp.optimization.surrogate.additive import ADDITIVE_MATERN52
from mebo_grasp.optimization.surrogate.bounded_bfgs import minimize_in_box
from mebo_grasp.optimization.surrogate.family import Structure, climb, prior_of, screened
from mebo_grasp.optimization.surrogate.gaussian_process import standardize
from mebo_grasp.optimization.surrogate.warping import StretchWarp

WIDE = 1e6


class Counted:
    """A loss that counts how often it was asked."""

    def __init__(self, function):
        self.function = function
        self.count = 0

    def __call__(self, x):
        self.count += 1
        return self.function(x)


def quadratic(H, centre):
    return lambda x: (0.5 * float((x - centre) @ H @ (x - centre)), H @ (x - centre))


def rosenbrock(x):
    a, b = 1.0 - x[0], x[1] - x[0] ** 2
    return a * a + 100.0 * b * b, np.array([-2.0 * a - 400.0 * b * x[0], 200.0 * b])


def coupled_matrix(size, condition, rng):
    """Symmetric with eigenvalues from 1 to ``condition`` along random axes."""
    Q = np.linalg.qr(rng.standard_normal((size, size)))[0]
    return (Q * np.geomspace(1.0, condition, size)) @ Q.T


def test_banana_valley_is_followed_to_its_end():
    end, value = minimize_in_box(rosenbrock, np.array([-1.2, 1.0]), np.full(2, -WIDE), np.full(2, WIDE), 100)
    np.testing.assert_allclose(end, 1.0, atol=2e-2)
    assert value < 1e-4


def test_corner_of_the_box_is_found():
    # Without the box the minimum is (3, -2); with x <= 1 it is (1, y) with y = -2 - 0.5 (1 - 3) = -1.
    H, centre = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, -2.0])
    end, _ = minimize_in_box(quadratic(H, centre), np.zeros(2), np.array([-5.0, -5.0]), np.array([1.0, 5.0]), 100)
    np.testing.assert_allclose(end, [1.0, -1.0], atol=1e-2)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 12))
def test_box_constrained_quadratics_agree_with_another_method(seed, size):
    rng = np.random.default_rng(seed)
    loss = quadratic(coupled_matrix(size, 1e3, rng), 2.0 * rng.standard_normal(size))
    lower, upper = -rng.random(size), rng.random(size)
    start = rng.uniform(-3.0, 3.0, size)
    end, value = minimize_in_box(loss, start, lower, upper, 300)
    assert np.all((end >= lower) & (end <= upper))
    assert value == pytest.approx(loss(end)[0])
    other = minimize(
        loss, np.zeros(size), jac=True, method="L-BFGS-B", bounds=list(zip(lower, upper, strict=True)),
        options={"ftol": 1e-14, "gtol": 1e-9, "maxiter": 5000, "maxfun": 50000},
    )  # fmt: skip
    assert value <= other.fun + 0.02


def test_ill_conditioned_valley_takes_few_evaluations():
    rng = np.random.default_rng(1)
    loss = Counted(quadratic(coupled_matrix(10, 1e5, rng), rng.standard_normal(10)))
    _, value = minimize_in_box(loss, np.zeros(10), np.full(10, -WIDE), np.full(10, WIDE), 200)
    assert value < 0.01
    assert loss.count < 80


def test_singular_region_is_backed_off_from():
    def loss(x):
        return (1e25, np.zeros(1)) if x[0] > 1.0 else (float((x[0] - 0.9) ** 2), 2.0 * (x - 0.9))

    end, _ = minimize_in_box(loss, np.array([-40.0]), np.array([-50.0]), np.array([50.0]), 100)
    assert end[0] == pytest.approx(0.9, abs=0.02)


def test_flat_start_stays():
    end, value = minimize_in_box(lambda _: (7.0, np.zeros(2)), np.array([0.3, 9.0]), np.zeros(2), np.ones(2), 10)
    np.testing.assert_array_equal(end, [0.3, 1.0])
    assert value == 7.0


def test_climb_of_a_stretched_member_ends_where_nothing_more_is_gained():
    c, s = np.cos(0.5), np.sin(0.5)
    U = latin_hypercube(60, 2, np.random.default_rng(0))
    V = (U - 0.5) @ np.array([[c, -s], [s, c]]).T / np.sqrt(2.0) + 0.5
    z = standardize(np.sum(np.sin(3.0 * np.arcsinh((V - 0.75) / 0.03)), axis=1))[0]
    structure = Structure(ADDITIVE_MATERN52, StretchWarp(), turned=True)
    prior = prior_of(structure.kernel, 2)
    ends = [climb(structure.kernel, U, z, start, 60) for start in screened(structure, U, z)[:3]]
    for vector, value in ends:
        again, gained = climb(structure.kernel, U, z, vector, 60)
        assert gained - value < 0.1
        assert np.all((again >= prior.lower) & (again <= prior.upper))


def test_a_curvature_that_rounding_spoilt_is_given_up(monkeypatch):
    """An update that leaves no inverse ended a run of the default method by numpy's error."""
    monkeypatch.setattr(bounded_bfgs, "_updated", lambda curvature, *_: np.zeros_like(curvature))
    loss = quadratic(np.diag([1.0, 2.0]), np.zeros(2))
    end, value = minimize_in_box(loss, np.array([3.0, 1.0]), np.full(2, -5.0), np.full(2, 5.0), 100)
    assert value == pytest.approx(loss(end)[0])
    assert value < 0.01 * loss(np.array([3.0, 1.0]))[0]
