"""Basins of a posterior: its local maxima, and which observation is the best one in the same basin.

Two points lie in one basin if the posterior mean, followed along the straight segment between them, never
dips below the lower end. Neighbourhoods and distances are measured in the kernel's own coordinates: inputs
after its map, in units of its lengthscales.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.belief import Belief
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.kernels import Kernel
from mebo_grasp.optimization.surrogate.warping import MappedKernel

BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.int64]

SEGMENT_SHARES = np.delete(np.linspace(0.0, 1.0, 11), [0, 5, 10])
"""Where a segment is probed besides its ends and its middle."""
TEST_ROUNDS = (0, 1, 4)
"""Of the observations near a candidate, best first, those from each of these on are tested together."""
NO_INCUMBENT = -1
LOCAL_CENTRES = 32
LOCAL_WIDTHS = np.array([0.03, 0.1, 0.3])
"""A local net's centres, and its standard deviations in lengthscales."""
SAME_MAXIMUM = 0.05
"""Ascents that end nearer than this, in lengthscales, found the same maximum."""

ValueAndGradient = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def mapped(kernel: Kernel, theta: FloatArray, U: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points after all maps of a kernel, shape (m, d), and the innermost kernel's parameters."""
    while isinstance(kernel, MappedKernel):
        theta, phi = kernel.split(theta, U.shape[1])
        U, kernel = kernel.map.forward(U, phi), kernel.base
    return U, theta


def unmapped(kernel: Kernel, theta: FloatArray, V: FloatArray) -> FloatArray:
    """Points whose image under all maps of a kernel is V, shape (m, d); without those outside the cube."""
    maps = []
    while isinstance(kernel, MappedKernel):
        theta, phi = kernel.split(theta, V.shape[1])
        maps.append((kernel.map, phi))
        kernel = kernel.base
    for input_map, phi in reversed(maps):
        V = input_map.inverse(V, phi)
        V = V[np.all((V >= 0.0) & (V <= 1.0), axis=1)]
    return V


class Coordinates:
    """The kernel's own coordinates of a posterior: mapped inputs over lengthscales; of all its parts."""

    def __init__(self, posterior: GaussianProcess | Belief) -> None:
        parts = posterior.parts if isinstance(posterior, Belief) else (posterior,)
        self._parts = [PartCoordinates(part) for part in parts]

    def __call__(self, U: FloatArray) -> FloatArray:
        """Coordinates of points, shape (m, k) with d of them for each part."""
        return np.concatenate([part(U) for part in self._parts], axis=1)

    def scales(self, net: FloatArray) -> FloatArray:
        """Typical length over which the posterior changes, of each dimension, at most 1, shape (d,).

        Args:
            net: points that fill the cube, shape (m, d).
        """
        rates = [np.ptp(part(net), axis=0) / np.maximum(np.ptp(net, axis=0), 1e-9) for part in self._parts]
        return 1.0 / np.maximum(np.max(rates, axis=0), 1.0)


class PartCoordinates:
    """The coordinates of one Gaussian process: mapped inputs over lengthscales."""

    def __init__(self, posterior: GaussianProcess) -> None:
        self._kernel = posterior.kernel
        self._theta = posterior.hyperparameters.theta
        _, inner = mapped(self._kernel, self._theta, np.full((1, posterior.dim), 0.5))
        # Lengthscales far beyond the side stand for dimensions without influence; they must not vanish.
        self._inverse = np.exp(-np.minimum(inner[: posterior.dim], np.log(4.0)))

    def __call__(self, U: FloatArray) -> FloatArray:
        """Coordinates of points, shape (m, d)."""
        scaled: FloatArray = mapped(self._kernel, self._theta, U)[0] * self._inverse
        return scaled


def search_net(posterior: GaussianProcess | Belief, size: int, rng: np.random.Generator) -> FloatArray:
    """Sobol points in the cube; if the kernel maps its inputs, half of them even in the mapped cube instead.

    Where the map stretches the inputs the function varies fast, and a net that is even in the cube would
    step over its maxima.
    """
    net = sobol(size, posterior.dim, rng)
    posterior = posterior.value if isinstance(posterior, Belief) else posterior
    if not isinstance(posterior.kernel, MappedKernel):
        return net
    half = size // 2
    return np.concatenate([net[:half], unmapped(posterior.kernel, posterior.hyperparameters.theta, net[half:])])


def local_net(posterior: GaussianProcess | Belief, size: int, rng: np.random.Generator) -> FloatArray:
    """Points around the best observations, shape (size, d), nearer than an even net's in many dimensions.

    Args:
        posterior: the surrogate.
        size: number of points.
        rng: source of randomness.
    """
    best = posterior.U[np.argsort(-posterior.y, kind="stable")[:LOCAL_CENTRES]]
    corners = np.stack([np.zeros(posterior.dim), np.ones(posterior.dim)])
    scales = Coordinates(posterior).scales(corners)
    width = scales * LOCAL_WIDTHS[rng.integers(len(LOCAL_WIDTHS), size=size)][:, None]
    centres = best[rng.integers(len(best), size=size)]
    return np.clip(centres + width * rng.standard_normal(centres.shape), 0.0, 1.0)


class Net:
    """Points with their nearest neighbours, which are sought only for those that are asked for.

    Args:
        points: shape (m, d), coordinates in which distances count.
        neighbours: how many count.
    """

    def __init__(self, points: FloatArray, neighbours: int) -> None:
        self._points = points
        self._tree = cKDTree(points)
        self._near = np.zeros((len(points), min(neighbours + 1, len(points))), dtype=np.int64)
        self._known = np.zeros(len(points), dtype=bool)

    def _neighbours(self, index: IndexArray) -> IndexArray:
        new = index[~self._known[index]]
        if len(new):
            near = self._tree.query(self._points[new], k=self._near.shape[1])[1]
            self._near[new] = np.asarray(near).reshape(len(new), -1)
            self._known[new] = True
        return self._near[index]

    def maxima(self, values: FloatArray, limit: int) -> IndexArray:
        """Indices of the best ``limit`` points with a value, of shape (m,), no lower than their neighbours'."""
        order = np.argsort(-values, kind="stable")
        kept = np.empty(0, dtype=np.int64)
        for start in range(0, len(order), 2 * limit):
            some = order[start : start + 2 * limit]
            top = values[some] >= np.max(values[self._neighbours(some)], axis=1)
            kept = np.concatenate([kept, some[top]])
            if len(kept) >= limit:
                break
        return kept[:limit]


def ascend(function: ValueAndGradient, starts: FloatArray, scales: FloatArray, steps: int) -> FloatArray:
    """Climb from all starts side by side by gradient steps with a length of its own each, in the cube.

    A step that gains is followed by a longer one, one that does not is taken back and shortened.

    Args:
        function: points (m, d) -> values (m,), gradients (m, d).
        starts: shape (m, d).
        scales: typical length of change of each dimension, shape (d,).
        steps: evaluations of the function.

    Returns:
        Ends, shape (m, d); no end is lower than its start.
    """
    points = starts.copy()
    values, gradients = function(points)
    lengths = np.full(len(points), 0.1)
    for _ in range(steps):
        uphill = gradients * scales
        # A component that points out of the cube must not shorten the others.
        blocked = ((points <= 0.0) & (uphill < 0.0)) | ((points >= 1.0) & (uphill > 0.0))
        uphill[blocked] = 0.0
        norms = np.linalg.norm(uphill, axis=1, keepdims=True)
        direction = uphill / np.maximum(norms, 1e-300) * scales
        proposals = np.clip(points + lengths[:, None] * direction, 0.0, 1.0)
        new_values, new_gradients = function(proposals)
        better = new_values > values
        points[better], values[better] = proposals[better], new_values[better]
        gradients[better] = new_gradients[better]
        lengths = np.where(better, 1.6 * lengths, 0.35 * lengths)
    return points


def distinct(values: FloatArray, coordinates: FloatArray, radius: float) -> IndexArray:
    """Indices of points, best first, that keep ``radius`` from better ones in ``coordinates``."""
    order = np.argsort(-values, kind="stable")
    kept: list[int] = []
    for index in order:
        if not kept or np.min(np.linalg.norm(coordinates[kept] - coordinates[index], axis=1)) >= radius:
            kept.append(int(index))
    return np.array(kept, dtype=np.int64)


def same_basin(posterior: GaussianProcess | Belief, A: FloatArray, B: FloatArray, slack: float) -> BoolArray:
    """Whether the posterior mean does not dip between A_i and B_i by more than ``slack``, shape (m,).

    Args:
        posterior: the surrogate.
        A: one end of each segment, shape (m, d).
        B: the other end, shape (m, d).
        slack: dip below the lower end that is forgiven, units of y.
    """
    if len(A) == 0:
        return np.zeros(0, dtype=bool)

    def means(shares: FloatArray, few: BoolArray) -> FloatArray:
        points = (1.0 - shares[:, None, None]) * A[few] + shares[:, None, None] * B[few]
        return posterior.predict_mean(points.reshape(-1, A.shape[1])).reshape(len(shares), -1)

    # Most segments that dip do so in the middle, and then need not be followed.
    start, middle, end = means(np.array([0.0, 0.5, 1.0]), np.ones(len(A), dtype=bool))
    floor = np.minimum(start, end) - slack
    connected: BoolArray = middle >= floor
    if np.any(connected):
        connected[connected] = np.min(means(SEGMENT_SHARES, connected), axis=0) >= floor[connected]
    return connected


@dataclass(frozen=True, eq=False)
class LocalIncumbents:
    """For each of m candidates the best observation in its basin, among those near it.

    Args:
        index: which observation, shape (m,); ``NO_INCUMBENT`` where none of them shares the basin.
        reach: distance of the farthest of those near it in the kernel's coordinates and in the cube's, shape (m, 2).
        gap: distance of the nearest of all observations in the kernel's coordinates, shape (m,).
    """

    index: IndexArray
    reach: FloatArray
    gap: FloatArray


def local_incumbents(
    posterior: GaussianProcess | Belief,
    candidates: FloatArray,
    U: FloatArray,
    y: FloatArray,
    count: int,
    slack: float,
) -> LocalIncumbents:
    """Find the best observation in the basin of each candidate among its nearest.

    The nearest are taken in the kernel's coordinates and in the cube's: a kernel that thinks little of some
    dimension would call points neighbours that lie far apart.

    Args:
        posterior: the surrogate.
        candidates: shape (m, d).
        U: observed points, shape (n, d).
        y: their values, shape (n,).
        count: how many are near a candidate in each of the two coordinates.
        slack: see ``same_basin``.
    """
    coordinates = Coordinates(posterior)
    count = min(count, len(U))
    by_kernel = cKDTree(coordinates(U)).query(coordinates(candidates), k=count)
    by_cube = cKDTree(U).query(candidates, k=count)
    nearest = (by_kernel, by_cube)
    index = np.concatenate([np.asarray(i, dtype=np.int64).reshape(-1, count) for _, i in nearest], axis=1)
    reach = np.stack([np.asarray(far).reshape(-1, count)[:, -1] for far, _ in nearest], axis=1)
    ranked = np.take_along_axis(index, np.argsort(-y[index], axis=1, kind="stable"), axis=1)
    # Many are near in both coordinates; each pair is tested once.
    fresh = np.ones(ranked.shape, dtype=bool)
    fresh[:, 1:] = ranked[:, 1:] != ranked[:, :-1]
    found = np.full(len(candidates), NO_INCUMBENT, dtype=np.int64)
    # The best first: where it shares the basin, the others need no test.
    for first, last in itertools.pairwise((*TEST_ROUNDS, ranked.shape[1])):
        open_ones = np.flatnonzero(found == NO_INCUMBENT)
        rows, columns = np.nonzero(fresh[open_ones, first:last])
        rows, ends = open_ones[rows], ranked[open_ones, first:last][rows, columns]
        shared = same_basin(posterior, candidates[rows], U[ends], slack)
        # Ends are in order of value within a row, so writing them backwards leaves the best.
        found[rows[shared][::-1]] = ends[shared][::-1]
    return LocalIncumbents(found, reach, np.asarray(by_kernel[0]).reshape(-1, count)[:, 0])


def within_reach(belief: Belief, candidates: FloatArray, point: FloatArray, reach: FloatArray) -> BoolArray:
    """Whether a further point, shape (d,), would be among the neighbours of candidates, shape (m, d).

    Args:
        belief: the surrogate.
        candidates: shape (m, d).
        point: shape (d,).
        reach: that of their neighbours, shape (m, 2).
    """
    if len(candidates) == 0:
        return np.zeros(0, dtype=bool)
    coordinates = Coordinates(belief)
    by_kernel = np.linalg.norm(coordinates(candidates) - coordinates(point[None]), axis=1)
    by_cube = np.linalg.norm(candidates - point, axis=1)
    near: BoolArray = (by_kernel <= reach[:, 0]) | (by_cube <= reach[:, 1])
    return near


def representatives(
    posterior: GaussianProcess | Belief,
    U: FloatArray,
    y: FloatArray,
    slack: float,
    limit: int | None = None,
    floor: float = -np.inf,
) -> IndexArray:
    """Best observation of each basin, best first.

    Args:
        posterior: the surrogate.
        U: observed points, shape (n, d).
        y: their values, shape (n,).
        slack: see ``same_basin``.
        limit: stop after this many.
        floor: observations below this value are left out.
    """
    order = np.argsort(-y, kind="stable")
    kept: list[int] = []
    for index in order[y[order] >= floor]:
        if limit is not None and len(kept) >= limit:
            break
        others = U[kept]
        here = np.broadcast_to(U[index], others.shape)
        if not np.any(same_basin(posterior, here, others, slack)):
            kept.append(int(index))
    return np.array(kept, dtype=np.int64)
