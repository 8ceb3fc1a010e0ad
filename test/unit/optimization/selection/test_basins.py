"""Basins of posteriors whose shape is known."""

import numpy as np
import pytest

from mebo_grasp.optimization.selection import basins
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel, Turn

PEAKS = np.array([0.2, 0.5, 0.8])


def three_peaks(U):
    """Peaks of height 1 at 0.2, 0.5, 0.8 and valleys of depth -1 between them."""
    return np.cos(2.0 * np.pi * (U[:, 0] - 0.2) / 0.3)


@pytest.fixture(scope="module")
def posterior():
    U = np.linspace(0.0, 1.0, 31)[:, None]
    return GaussianProcess.fit(
        U, three_peaks(U), Hyperparameters(np.log([0.12, 2.0]), np.log(1e-8)), SQUARED_EXPONENTIAL
    )


def test_all_maxima_of_a_known_function_are_found(posterior):
    net = basins.search_net(posterior, 128, np.random.default_rng(0))
    top = basins.neighbourhood_maxima(posterior.predict_mean(net), basins.Coordinates(posterior)(net), 4)

    def mean(points):
        return posterior.predict_mean(points), posterior.mean_gradient(points)

    ends = basins.ascend(mean, net[top], np.array([0.12]), 25)
    values = posterior.predict_mean(ends)
    kept = basins.distinct(values, basins.Coordinates(posterior)(ends), basins.SAME_MAXIMUM)
    best = ends[kept][:3, 0]
    np.testing.assert_allclose(np.sort(best), PEAKS, atol=2e-3)


def test_ascent_stays_in_the_cube_and_never_falls():
    def slope(points):
        return points @ np.array([1.0, -2.0]), np.tile([1.0, -2.0], (len(points), 1))

    starts = np.random.default_rng(0).random((20, 2))
    ends = basins.ascend(slope, starts, np.ones(2), 30)
    np.testing.assert_allclose(ends, np.tile([1.0, 0.0], (20, 1)))


def test_same_basin_follows_the_mean(posterior):
    A = np.array([[0.2], [0.2], [0.15], [0.2]])
    B = np.array([[0.25], [0.5], [0.24], [0.8]])
    np.testing.assert_array_equal(
        basins.same_basin(posterior, A, B, 1e-3), np.array([True, False, True, False])
    )
    # A dip of 2 is forgiven by a slack of 3.
    assert np.all(basins.same_basin(posterior, A, B, 3.0))


def test_representatives_are_one_point_a_basin_and_the_best_of_it(posterior):
    U, y = posterior.U, posterior.y
    kept = basins.representatives(posterior, U, y, 1e-3, floor=0.0)
    assert len(kept) == 3
    for peak in PEAKS:
        within = np.abs(U[:, 0] - peak) < 0.15
        best = np.flatnonzero(within)[np.argmax(y[within])]
        assert np.min(np.abs(U[kept, 0] - U[best, 0])) < 1e-9
    assert np.all(np.diff(y[kept]) <= 0.0)
    assert len(basins.representatives(posterior, U, y, 1e-3, limit=2)) == 2


def test_basin_neighbours_know_the_valleys(posterior):
    near = basins.basin_neighbours(posterior, np.array([[0.5]]), posterior.U, 12, 1e-3)
    distance = np.abs(posterior.U[near.index[0], 0] - 0.5)
    assert np.all(near.shared[0][distance < 0.14])
    assert not np.any(near.shared[0][distance > 0.16])


def test_a_stretched_input_gets_more_of_the_net():
    # a = 0.3 stretches the lower end: w(0.05) = 0.41, so about (0.05 + 0.41) / 2 of the net lies below 0.05.
    kernel = MappedKernel(MATERN52, KumaraswamyWarp())
    theta = np.append(MATERN52.prior(1).mean, np.log([0.3, 1.0]))
    posterior = GaussianProcess.fit(np.array([[0.5]]), np.array([1.0]), Hyperparameters(theta, -10.0), kernel)
    net = basins.search_net(posterior, 1024, np.random.default_rng(0))
    assert np.mean(net < 0.05) == pytest.approx(0.5 * (0.05 + 0.05**0.3), abs=0.01)


def test_unmapping_undoes_all_maps():
    kernel = MappedKernel(MappedKernel(MATERN52, KumaraswamyWarp()), Turn())
    theta = np.concatenate([MATERN52.prior(2).mean, [0.3, -0.4, 0.2, 0.5], [0.6]])
    U = 0.05 + 0.9 * np.random.default_rng(0).random((50, 2))
    V, _ = basins.mapped(kernel, theta, U)
    np.testing.assert_allclose(basins.unmapped(kernel, theta, V), U, atol=1e-9)
