"""Where the default method looks under input noise: a belief with a cliff beside its summit."""

import numpy as np
import pytest
from scipy.stats import norm

from mebo_grasp.optimization.acquisition.unscented import UnscentedTransform
from mebo_grasp.optimization.selection.safe_search import deviation, is_tried, most_hopeful, pick_safe
from mebo_grasp.optimization.surrogate.belief import PlateauSurrogate

SD = 0.05
NOISE = UnscentedTransform.of_draws(np.eye(2) * SD**2, 16)


def cliff(U):
    """Rises to u0 = 0.7 and is 0 beyond."""
    return np.where(U[:, 0] < 0.7, 0.2 + U[:, 0], 0.0)


def belief(n=80):
    rng = np.random.default_rng(0)
    U = rng.random((n, 2))
    return PlateauSurrogate(2).update(U, cliff(U), rng).best


def test_the_most_hopeful_point_keeps_away_from_the_cliff():
    at = most_hopeful(belief(), NOISE, np.random.default_rng(1))
    grid = np.linspace(0.0, 1.0, 201)[:, None] * [1.0, 0.0] + [0.0, 0.5]
    best = grid[np.argmax(NOISE.mean(cliff(NOISE.points(grid))))]
    assert best[0] < 0.65
    assert abs(at[0] - best[0]) < 0.06


def test_a_point_that_was_tried_gives_way_to_the_least_known_one_around_it():
    known = belief(120)
    centre = most_hopeful(known, NOISE, np.random.default_rng(1))
    assert not is_tried(known.U, centre, NOISE)
    assert np.array_equal(pick_safe(known, NOISE, np.random.default_rng(1)), centre)
    for _ in range(10):
        U = np.concatenate([known.U, centre[None]])
        known = PlateauSurrogate(2).update(U, cliff(U), np.random.default_rng(0)).best
        centre = most_hopeful(known, NOISE, np.random.default_rng(1))
        if is_tried(U, centre, NOISE):
            break
    assert is_tried(U, centre, NOISE)
    around = NOISE.points(centre[None])
    doubtful = around[np.argmax(deviation(known, around))]
    assert np.array_equal(pick_safe(known, NOISE, np.random.default_rng(1)), doubtful)
    assert not np.array_equal(doubtful, centre)


def test_near_is_measured_in_the_noise_s_deviations():
    noise = UnscentedTransform.of_draws(np.diag([0.1**2, 0.0]), 256)
    U, point = np.array([[0.5, 0.5]]), np.array([0.54, 0.5])
    assert is_tried(U, point, noise)
    assert not is_tried(U, np.array([0.56, 0.5]), noise)
    assert not is_tried(U, np.array([0.54, 0.5 + 1e-6]), noise)


def test_deviation_is_that_of_a_value_that_may_be_on_the_plateau():
    known, A = belief(), np.array([[0.69, 0.5], [0.3, 0.5]])
    mean, sd = known.predict(A)
    chance = np.exp(known.log_chances(A))
    # In equal steps of probability: the few that fall on the plateau decide, and drawn ones are too few to count.
    share = (np.arange(2_000_000) + 0.5) / 2_000_000
    for i in range(2):
        off = share < chance[i]
        values = np.where(off, mean[i] + sd[i] * norm.ppf(np.minimum(share / chance[i], 1.0 - 1e-12)), known.floor)
        assert deviation(known, A)[i] == pytest.approx(values.std(), rel=0.01)
