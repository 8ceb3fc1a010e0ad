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
    top = basins.Net(basins.Coordinates(posterior)(net), 4).maxima(posterior.predict_mean(net), 128)

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
    np.testing.assert_array_equal(basins.same_basin(posterior, A, B, 1e-3), np.array([True, False, True, False]))
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


def test_the_best_maxima_of_a_net_are_those_of_all_points_compared_with_all():
    rng = np.random.default_rng(0)
    points, values = rng.random((200, 3)), rng.random(200)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.argsort(distances, axis=1)[:, :6]
    order = np.argsort(-values)
    expected = [i for i in order if values[i] >= values[near[i]].max()]
    assert 12 < len(expected) < 100
    net = basins.Net(points, 5)
    for limit in (1, 12, 200):
        np.testing.assert_array_equal(net.maxima(values, limit), expected[:limit])


def test_the_local_incumbent_is_the_best_observation_before_the_next_valley(posterior):
    U, y = posterior.U, posterior.y
    # Between its valleys at 0.35 and 0.65 the middle peak is not told from the others by its value.
    higher = y + np.where(np.abs(U[:, 0] - 0.8) < 0.1, 0.5, 0.0)
    candidates = np.array([[0.42], [0.5], [0.58], [0.77]])
    near = basins.local_incumbents(posterior, candidates, U, higher, 20, 1e-3)
    np.testing.assert_allclose(U[near.index, 0], [0.5, 0.5, 0.5, 0.8], atol=1e-9)
    # All that are near a point at the bottom of a valley lie up one of its slopes, none in a basin of its own.
    np.testing.assert_allclose(near.reach[:, 1], np.sort(np.abs(candidates - U[:, 0]), axis=1)[:, 19])


def test_without_an_observation_in_the_basin_there_is_no_incumbent():
    # A sure valley between a candidate on a peak that was assumed and the only observation near it.
    U, y = np.array([[0.1], [0.5], [0.9]]), np.array([1.0, 0.0, 1.0])
    model = GaussianProcess.fit(U, y, Hyperparameters(np.log([0.12, 2.0]), np.log(1e-8)), SQUARED_EXPONENTIAL)
    near = basins.local_incumbents(model, np.array([[0.9]]), U[:1], y[:1], 1, 1e-3)
    assert near.index[0] == basins.NO_INCUMBENT


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
