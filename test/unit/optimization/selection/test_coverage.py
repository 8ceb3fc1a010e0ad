import numpy as np
import pytest
from scipy.special import ndtr

from mebo_grasp.optimization.selection.coverage import (
    ball_offsets,
    ball_reach,
    expected_coverage_improvement,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess


def test_offsets_are_uniform_in_the_ball():
    radii = np.linalg.norm(ball_offsets(20000, 3, np.random.default_rng(0)), axis=1)
    assert radii.max() <= 1.0
    assert np.mean(radii**3) == pytest.approx(0.5, abs=0.01)


def eci(candidate, tried, threshold=-1e9, radius=0.1, scale=1.0, n=4000):
    posterior = GaussianProcess.fit(np.array([[0.2], [0.9]]), np.array([0.0, 1.0]))
    offsets = ball_offsets(n, 1, np.random.default_rng(1))
    places, known = np.array([[candidate]]), np.array(tried)[:, None]
    return expected_coverage_improvement(posterior, places, offsets, known, threshold, np.array([scale]), radius)[0]


def test_where_all_is_good_it_is_the_uncovered_share_of_the_ball():
    assert eci(0.5, [0.9]) == pytest.approx(1.0)
    assert eci(0.5, [0.5]) == pytest.approx(0.0, abs=1e-3)
    # In one dimension the ball [0.4, 0.6] loses [0.4, 0.55] to a point at 0.45: a quarter is left.
    assert eci(0.5, [0.45]) == pytest.approx(0.25, abs=0.03)


def test_places_outside_the_cube_are_worth_nothing():
    assert eci(0.0, [0.9]) == pytest.approx(0.5, abs=0.03)


def test_radius_is_in_real_units():
    assert eci(0.5, [0.45], radius=10.0, scale=100.0) == pytest.approx(0.25, abs=0.03)


def test_a_ball_has_the_whole_of_a_side_that_counts_nothing():
    assert ball_reach(2.0, np.array([4.0, 0.5, 0.0])).tolist() == [0.5, 4.0, 1.0]


def test_chance_of_being_good_is_the_posteriors():
    posterior = GaussianProcess.fit(np.array([[0.2], [0.9]]), np.array([0.0, 1.0]))
    mean, sd = posterior.predict(np.array([[0.5]]))
    value = eci(0.5, [0.95], threshold=0.7, radius=1e-6)
    assert value == pytest.approx(ndtr((mean - 0.7) / sd)[0], abs=1e-3)
