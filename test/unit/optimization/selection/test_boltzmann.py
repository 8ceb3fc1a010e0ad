import numpy as np
import pytest
from scipy.stats import kstest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.acquisition.base import Acquisition
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement
from mebo_grasp.optimization.selection.boltzmann import (
    BoltzmannSettings,
    Box,
    LogTarget,
    draw,
    metropolis_hastings,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess


def test_chains_reach_a_known_density_from_a_bad_start():
    # Target exp(8 x) on [0, 1]; distribution function (exp(8 x) - 1) / (exp(8) - 1). All chains start at 0.
    starts = np.zeros((4000, 1))
    ends = metropolis_hastings(lambda x: 8.0 * x[:, 0], starts, 150, Box.unit(1), np.random.default_rng(0))
    assert kstest(ends[:, 0], lambda x: np.expm1(8.0 * x) / np.expm1(8.0)).pvalue > 1e-3


def test_chains_visit_two_separate_modes_in_proportion():
    # Two narrow normals of equal height, the right one twice as wide: twice the mass.
    def log_density(x):
        left = -0.5 * ((x[:, 0] - 0.2) / 0.01) ** 2
        right = -0.5 * ((x[:, 0] - 0.8) / 0.02) ** 2
        return np.logaddexp(left, right)

    starts = np.full((3000, 1), 0.2)
    ends = metropolis_hastings(log_density, starts, 600, Box.unit(1), np.random.default_rng(1))
    assert np.mean(ends[:, 0] > 0.5) == pytest.approx(2.0 / 3.0, abs=0.05)


def test_chains_stay_in_the_box():
    box = Box(np.array([0.2, 0.5]), np.array([0.3, 0.9]))
    ends = metropolis_hastings(
        lambda x: 5.0 * x[:, 0], np.full((500, 2), [0.25, 0.6]), 60, box, np.random.default_rng(0)
    )
    assert np.all((ends >= box.lower) & (ends <= box.upper))
    assert len(np.unique(ends[:, 0])) > 400


def test_standardized_target_ignores_units_of_the_acquisition():
    values = np.random.default_rng(0).random(64)
    settings = BoltzmannSettings(beta=2.0)
    plain, scaled = LogTarget(values, settings), LogTarget(1e6 * values - 40.0, settings)
    assert np.allclose(plain(values[:5]), scaled(1e6 * values[:5] - 40.0))
    assert np.std(plain(values)) == pytest.approx(2.0)


def test_flat_acquisition_gives_a_uniform_target():
    assert np.all(LogTarget(np.full(8, 0.0), BoltzmannSettings())(np.zeros(3)) == 0.0)


def test_proportional_target_is_the_log_of_the_acquisition():
    target = LogTarget(np.array([0.0, 4.0]), BoltzmannSettings(proportional=True))
    assert np.allclose(target(np.array([1.0, 4.0])), np.log([1.0, 4.0]))
    assert np.isneginf(target(np.array([0.0]))[0])


def posterior():
    U = np.linspace(0.0, 1.0, 9)[:, None]
    return GaussianProcess.fit(U, np.sin(6.0 * U[:, 0]))


def test_greater_beta_draws_higher_acquisition():
    gp, ucb = posterior(), UpperConfidenceBound(2.0)
    means = []
    for beta in (0.0, 2.0, 8.0):
        settings = BoltzmannSettings(beta=beta, chains=200, burn_in=2000)
        queries = draw(gp, [ucb], np.random.default_rng(0), settings, per_acquisition=200)[0]
        means.append(float(np.mean(ucb.value(*gp.predict(queries)))))
    assert means[0] < means[1] < means[2]


def test_queries_follow_the_boltzmann_density():
    gp, ucb = posterior(), UpperConfidenceBound(2.0)
    settings = BoltzmannSettings(beta=1.5, chains=1500, burn_in=60_000)
    queries = draw(gp, [ucb], np.random.default_rng(3), settings, per_acquisition=1500)[0, :, 0]
    grid = (np.arange(4000)[:, None] + 0.5) / 4000
    values = ucb.value(*gp.predict(grid))
    density = np.exp(1.5 * (values - values.mean()) / values.std())
    cdf = np.cumsum(density) / density.sum()
    assert kstest(queries, lambda x: np.interp(x, grid[:, 0], cdf)).pvalue > 1e-3


def test_shape_seed_and_box():
    gp = posterior()
    acquisitions: list[Acquisition] = [ExpectedImprovement(0.9), UpperConfidenceBound(2.0)]
    box = Box(np.array([0.4]), np.array([0.45]))
    first = draw(gp, acquisitions, np.random.default_rng(7), per_acquisition=5, box=box)
    assert first.shape == (2, 5, 1)
    assert np.all((first >= 0.4) & (first <= 0.45))
    again, other = (draw(gp, acquisitions, np.random.default_rng(seed), per_acquisition=5, box=box) for seed in (7, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("bad", [{"beta": -1.0}, {"beta": np.nan}, {"burn_in": 0}, {"chains": 0}])
def test_settings_are_checked(bad):
    with pytest.raises(InvalidSettingsError):
        BoltzmannSettings(**bad)
