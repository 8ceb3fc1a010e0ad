import json
from dataclasses import asdict

import numpy as np
import pytest
from scipy.stats import norm

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.acquisition.base import OnPosterior
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement, LogExpectedImprovement
from mebo_grasp.optimization.acquisition.unscented import (
    LogUnscented,
    Unscented,
    UnscentedTransform,
    unscented_outcomes,
)
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters

FULL = np.array([[4.0, 1.0, -0.5], [1.0, 2.0, 0.3], [-0.5, 0.3, 1.0]]) * 1e-4


def posterior(dim=3, n=30):
    rng = np.random.default_rng(4)
    U = rng.random((n, dim))
    return GaussianProcess.fit(U, np.sin(5.0 * U).sum(axis=1))


@pytest.mark.parametrize("kappa", [None, 0.0, 2.0, -1.0])
def test_mean_of_a_quadratic_and_covariance_of_a_linear_function_are_exact(kappa):
    transform = UnscentedTransform.of_covariance(FULL, kappa)
    A = np.array([[0.3, 0.5, 0.6], [0.4, 0.4, 0.5]])
    H = np.array([[1.0, 2.0, 0.0], [2.0, -3.0, 1.0], [0.0, 1.0, 4.0]])
    slope = np.array([1.0, -2.0, 3.0])
    points = transform.points(A)
    quadratic = np.einsum("ni,ij,nj->n", points, H, points) + points @ slope
    expected = np.einsum("ni,ij,nj->n", A, H, A) + A @ slope + np.trace(H @ FULL)
    assert transform.mean(quadratic) == pytest.approx(expected, abs=1e-13)
    mean, sd = transform.moments(points @ slope)
    assert mean == pytest.approx(A @ slope)
    assert sd == pytest.approx(np.sqrt(slope @ FULL @ slope))


@pytest.mark.parametrize(("dim", "kappa"), [(1, 2.0), (2, None), (3, None)])
def test_fourth_moment_of_one_axis_is_exact_with_three_less_d(dim, kappa):
    transform = UnscentedTransform.of_covariance(0.01 * np.eye(dim), kappa)
    points = transform.points(np.full((1, dim), 0.5))[:, 0] - 0.5
    assert transform.mean(points**4)[0] == pytest.approx(3.0 * 0.01**2)


@pytest.mark.parametrize(("dim", "centre"), [(1, 1 / 2), (2, 1 / 3), (3, 0.0), (6, 0.0)])
def test_the_point_itself_has_at_most_half_of_the_weight_by_default(dim, centre):
    transform = UnscentedTransform.of_covariance(np.eye(dim))
    assert transform.weights == pytest.approx([centre, *[(1.0 - centre) / (2 * dim)] * (2 * dim)])


def test_sigma_points_are_2d_plus_1_in_the_paper_s_places():
    transform = UnscentedTransform.of_covariance(np.diag([0.01, 0.04]), 1.0)
    shifts = np.sqrt(3.0) * np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.2], [-0.1, 0.0], [0.0, -0.2]])
    assert transform.shifts == pytest.approx(shifts)
    assert transform.weights == pytest.approx([1 / 3, 1 / 6, 1 / 6, 1 / 6, 1 / 6])
    with pytest.raises(InvalidSettingsError, match="kappa"):
        UnscentedTransform.of_covariance(np.eye(2), -2.0)


def test_draws_have_the_noise_s_moments_and_see_a_corner_that_sigma_points_miss():
    draws = UnscentedTransform.of_draws(FULL, 1024)
    assert np.sum(draws.weights) == pytest.approx(1.0)
    assert draws.weights @ draws.shifts == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.allclose((draws.weights[:, None] * draws.shifts).T @ draws.shifts, FULL, atol=2e-6)
    flat = UnscentedTransform.of_draws(np.diag([0.01, 0.0]), 16)
    assert not flat.shifts[:, 1].any()

    def corner(points):
        """1 but where both coordinates are half a deviation too large."""
        return np.where(np.all(points > 0.55, axis=1), 0.0, 1.0)

    at = np.array([[0.5, 0.5]])
    truth = 1.0 - norm.sf(0.5) ** 2
    sigma, drawn = (
        UnscentedTransform.of_covariance(np.eye(2) * 0.01),
        UnscentedTransform.of_draws(np.eye(2) * 0.01, 64),
    )
    assert sigma.mean(corner(sigma.points(at)))[0] == pytest.approx(1.0)
    assert drawn.mean(corner(drawn.points(at)))[0] == pytest.approx(truth, abs=0.02)


def test_points_are_clipped_and_a_clipped_coordinate_has_no_slope():
    transform = UnscentedTransform.of_covariance(np.eye(2) * 0.01, 1.0)
    A = np.array([[0.0, 0.5]])
    points = transform.points(A)
    assert np.all((points >= 0.0) & (points <= 1.0))
    slopes = transform.pulled_back(A, np.ones((5, 2)))
    assert slopes[0].tolist() == [[1, 1], [1, 1], [1, 1], [0, 1], [1, 1]]


def test_expected_improvement_is_the_weighted_sum_over_sigma_points():
    model, transform = posterior(), UnscentedTransform.of_covariance(FULL)
    plain = OnPosterior(ExpectedImprovement(1.0), model)
    A = np.random.default_rng(0).random((4, 3))
    sigma = list(zip(transform.shifts, transform.weights, strict=True))
    by_hand = [sum(w * plain(np.clip(a + s, 0, 1)[None])[0] for s, w in sigma) for a in A]
    assert Unscented(plain, transform)(A) == pytest.approx(by_hand)
    log_plain = OnPosterior(LogExpectedImprovement(1.0), model)
    assert np.exp(LogUnscented(log_plain, transform)(A)) == pytest.approx(by_hand)


@pytest.mark.parametrize("kappa", [None, 0.0, -0.5])
def test_gradients_agree_with_differences(kappa):
    model, transform = posterior(), UnscentedTransform.of_covariance(4.0 * FULL, kappa)
    for worth in (
        Unscented(OnPosterior(UpperConfidenceBound(2.0), model), transform),
        Unscented(OnPosterior(ExpectedImprovement(1.0), model), transform),
        LogUnscented(OnPosterior(LogExpectedImprovement(1.0), model), transform),
    ):
        A = np.concatenate([0.2 + 0.6 * np.random.default_rng(1).random((5, 3)), [[0.01, 0.99, 0.5]]])
        values, gradient = worth.with_gradient(A)
        assert values == pytest.approx(worth(A))
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            assert gradient[:, axis] == pytest.approx((worth(A + step) - worth(A - step)) / 2e-6, rel=1e-4, abs=1e-6)


def test_a_negative_mean_of_a_positive_worth_has_no_logarithm():
    class Centre:
        def __call__(self, A):
            return np.where(np.abs(A - 0.5).max(axis=1) < 1e-9, 0.0, -50.0)

        def with_gradient(self, A):
            return self(A), np.ones_like(A)

    transform = UnscentedTransform.of_covariance(np.eye(4) * 1e-4, -1.0)
    value, gradient = LogUnscented(Centre(), transform).with_gradient(np.full((1, 4), 0.5))
    assert np.isneginf(value[0])
    assert not gradient.any()


def test_the_broad_summit_is_the_incumbent_where_the_narrow_one_is_higher():
    def truth(A):
        x = A[:, 0]
        return np.exp(-(((x - 0.3) / 0.15) ** 2)) + 1.4 * np.exp(-(((x - 0.8) / 0.01) ** 2))

    U = np.linspace(0.0, 1.0, 101)[:, None]
    model = GaussianProcess.fit(U, truth(U), Hyperparameters(np.log([0.02, 1.0]), np.log(1e-6)))
    expected, sd, worst = unscented_outcomes(model.predict_mean, U, UnscentedTransform.of_covariance([[0.02**2]]))
    assert U[np.argmax(model.predict_mean(U)), 0] == pytest.approx(0.8)
    best = int(np.argmax(expected))
    assert U[best, 0] == pytest.approx(0.3, abs=0.02)
    assert sd[best] < 0.1 < sd[80]
    assert worst[best] > 0.9 > worst[80]


def test_no_queries_have_no_outcomes():
    transform = UnscentedTransform.of_covariance(FULL)
    assert [len(part) for part in unscented_outcomes(posterior().predict_mean, np.empty((0, 3)), transform)] == [0] * 3


def test_noise_in_every_unit_becomes_a_covariance_in_the_cube():
    space = SearchSpace(("x", "roll", "s"), np.array([0.0, -1.0, 0.0]), np.array([0.5, 1.0, 1.0]), ("m", "rad", "1"))
    assert InputNoise((0.03,)).in_cube(space) == pytest.approx(np.eye(3) * 9e-4)
    assert InputNoise((0.01, 0.1, 0.2), "space").in_cube(space) == pytest.approx(np.diag([0.02, 0.05, 0.2]) ** 2)
    assert InputNoise.of_pose(0.01, 0.1).in_cube(space) == pytest.approx(np.diag([0.02, 0.05, 0.0]) ** 2)
    assert InputNoise.covariance(FULL).in_cube(space) == pytest.approx(FULL)
    scaled = FULL / np.outer([0.5, 2.0, 1.0], [0.5, 2.0, 1.0])
    assert InputNoise.covariance(FULL, "space").in_cube(space) == pytest.approx(scaled)
    # A dimension without noise has a root as well.
    transform = UnscentedTransform.of_noise(InputNoise.of_pose(0.01, 0.0), space)
    assert not transform.shifts[:, 1:].any()


def test_a_covariance_of_one_dimension_is_a_variance():
    line = SearchSpace.unit_cube(1)
    assert InputNoise.covariance([[0.04]]).in_cube(line) == pytest.approx(np.array([[0.04]]))
    assert InputNoise((0.04,)).in_cube(line) == pytest.approx(np.array([[0.0016]]))
    for bad, word in (([[-0.04]], "at least 0"), ([0.04], "shape"), ([[0.1, 0.2]], "shape")):
        with pytest.raises(InvalidSettingsError, match=word):
            InputNoise.covariance(bad)


def test_a_record_of_noise_is_read_back_and_what_is_wrong_with_another_is_named():
    noise = InputNoise.of_pose(0.01, 0.1)
    assert InputNoise.from_json(json.loads(json.dumps(asdict(noise)))) == noise
    for bad, word in (
        ({"values": [0.1], "unit": "inch"}, "got 'inch'"),
        ({"values": ["much"]}, "unreadable"),
        ({"unit": "cube"}, "unreadable"),
        ({"values": [0.1], "colour": 3}, "must have values, unit and kappa"),
        ([0.1], "must have values, unit and kappa"),
    ):
        with pytest.raises(InvalidSettingsError, match=word):
            InputNoise.from_json(bad)


@pytest.mark.parametrize(
    ("noise", "word"),
    [
        (((), "cube"), "finite"),
        (((float("nan"),), "cube"), "finite"),
        (((0.1,), "inch"), "inch"),
        (((0.1,), "pose"), "metres"),
        (((-0.1,), "cube"), "at least 0"),
        (((0.1, 0.2), "cube"), "1, 3 or 9"),
        (((0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "cube"), "symmetric"),
        (((-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), "cube"), "negative"),
        (((0.1, 0.1), "pose"), "radians"),
    ],
)
def test_bad_noise_is_refused_with_its_value(noise, word):
    with pytest.raises(InvalidSettingsError, match=word):
        InputNoise(*noise).in_cube(SearchSpace.unit_cube(3))
