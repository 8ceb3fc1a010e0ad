import numpy as np
import pytest

from mebo_grasp.optimization.selection.trust_region import (
    INITIAL_LENGTH,
    TrustRegion,
    candidates_in_box,
    improves,
)


def after(region, outcomes, tolerance=4):
    for improved in outcomes:
        region = region.after(improved, tolerance)
    return region


def test_doubles_after_three_successes_in_a_row_up_to_its_limit():
    assert after(TrustRegion(), [True] * 2).length == INITIAL_LENGTH
    assert after(TrustRegion(), [True] * 3).length == 1.6
    assert after(TrustRegion(), [True] * 9).length == 1.6
    assert after(TrustRegion(), [True, True, False, True]).length == INITIAL_LENGTH


def test_halves_after_enough_failures_and_starts_again_when_too_short():
    assert after(TrustRegion(), [False] * 4).length == 0.4
    assert after(TrustRegion(), [False] * 3 + [True, False]).length == INITIAL_LENGTH
    # 0.8 / 2^6 = 0.0125 is the last above 2^-7; the seventh halving starts it again.
    assert after(TrustRegion(), [False] * 24).length == pytest.approx(0.0125)
    assert after(TrustRegion(), [False] * 28) == TrustRegion()


def test_box_has_the_volume_of_its_length_and_the_shape_of_the_lengthscales():
    lower, upper = TrustRegion(0.2).box(np.full(2, 0.5), np.array([0.1, 0.4]))
    assert np.allclose(upper - lower, [0.1, 0.4])
    lower, upper = TrustRegion(0.8).box(np.array([0.0, 1.0]), np.ones(2))
    assert np.allclose(lower, [0.0, 0.6])
    assert np.allclose(upper, [0.4, 1.0])


def test_success_needs_a_thousandth():
    assert improves(100.2, 100.0)
    assert not improves(100.05, 100.0)
    assert improves(-0.9, -1.0)
    assert improves(1e-9, 0.0)


def test_candidates_in_high_dimension_move_about_twenty_coordinates():
    rng = np.random.default_rng(0)
    centre = np.full(60, 0.5)
    points = candidates_in_box(np.zeros(60), np.ones(60), centre, rng)
    moved = (points != centre).sum(axis=1)
    assert points.shape == (5000, 60)
    assert 18 < moved.mean() < 22
    assert moved.min() >= 1
    assert candidates_in_box(np.zeros(2), np.ones(2), centre[:2], rng).shape == (2000, 2)
