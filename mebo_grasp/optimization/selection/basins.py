"""Basins of a posterior: its local maxima, and which observation is the best one in the same basin.

Two points lie in one basin if the posterior mean, followed along the straight segment between them, never
dips below the lower end. Neighbourhoods and distances are measured in the kernel's own coordinates: inputs
after its map, in units of its lengthscales.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.kernels import Kernel
from mebo_grasp.optimization.surrogate.warping import MappedKernel

BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.int64]

SEGMENT_POINTS = 9
"""Interior points at which a segment is probed."""
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
    """The kernel's own coordinates of a posterior: mapped inputs over lengthscales."""

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


def search_net(posterior: GaussianProcess, size: int, rng: np.random.Generator) -> FloatArray:
    """Sobol points in the cube; if the kernel maps its inputs, half of them even in the mapped cube instead.

    Where the map stretches the inputs the function varies fast, and a net that is even in the cube would
    step over its maxima.
    """
    net = sobol(size, posterior.dim, rng)
    if not isinstance(posterior.kernel, MappedKernel):
        return net
    half = size // 2
    return np.concatenate(
        [net[:half], unmapped(posterior.kernel, posterior.hyperparameters.theta, net[half:])]
    )


def neighbourhood_maxima(values: FloatArray, points: FloatArray, neighbours: int) -> IndexArray:
    """Indices of points with a value no lower than at their nearest ``neighbours``, best first.

    Args:
        values: shape (m,).
        points: shape (m, d), coordinates in which distances count.
        neighbours: how many.
    """
    count = min(neighbours + 1, len(values))
    if count < 2:
        return np.arange(len(values))
    _, near = cKDTree(points).query(points, k=count)
    top = np.flatnonzero(values >= np.max(values[near], axis=1))
    result: IndexArray = top[np.argsort(-values[top], kind="stable")]
    return result


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


def same_basin(posterior: GaussianProcess, A: FloatArray, B: FloatArray, slack: float) -> BoolArray:
    """Whether the posterior mean does not dip between A_i and B_i by more than ``slack``, shape (m,).

    Args:
        posterior: the surrogate.
        A: one end of each segment, shape (m, d).
        B: the other end, shape (m, d).
        slack: dip below the lower end that is forgiven, units of y.
    """
    if len(A) == 0:
        return np.zeros(0, dtype=bool)
    shares = np.linspace(0.0, 1.0, SEGMENT_POINTS + 2)[:, None, None]
    points = (1.0 - shares) * A + shares * B
    means = posterior.predict_mean(points.reshape(-1, A.shape[1])).reshape(len(shares), len(A))
    lower_end = np.minimum(means[0], means[-1])
    connected: BoolArray = np.min(means, axis=0) >= lower_end - slack
    return connected


@dataclass(frozen=True, eq=False)
class Neighbours:
    """For each of m candidates k observations near it: indices and which of them share its basin.

    Args:
        index: shape (m, k).
        shared: shape (m, k).
    """

    index: IndexArray
    shared: BoolArray


def basin_neighbours(
    posterior: GaussianProcess, candidates: FloatArray, U: FloatArray, count: int, slack: float
) -> Neighbours:
    """Find the nearest observations of each candidate and test each for the same basin.

    The nearest are taken in the kernel's coordinates and in the cube's: a kernel that thinks little of some
    dimension would call points neighbours that lie far apart.

    Args:
        posterior: the surrogate.
        candidates: shape (m, d).
        U: observed points, shape (n, d).
        count: how many are tested a candidate in each of the two coordinates.
        slack: see ``same_basin``.
    """
    coordinates = Coordinates(posterior)
    count = min(count, len(U))
    _, by_kernel = cKDTree(coordinates(U)).query(coordinates(candidates), k=count)
    _, by_cube = cKDTree(U).query(candidates, k=count)
    index = np.concatenate(
        [np.asarray(near, dtype=np.int64).reshape(-1, count) for near in (by_kernel, by_cube)], axis=1
    )
    starts = np.repeat(candidates, index.shape[1], axis=0)
    shared = same_basin(posterior, starts, U[index.ravel()], slack).reshape(index.shape)
    return Neighbours(index, shared)


def representatives(
    posterior: GaussianProcess,
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
