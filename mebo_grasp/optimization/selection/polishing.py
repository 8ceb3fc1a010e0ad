"""Local search that needs no model: closes in on incumbents by the distances to their neighbours.

A Gaussian process believes in smooth summits. Where the function has a kink or a jump at its maximum (a grasp is
best just before the fingers lose it), the model goes on to round it off, however many values it has. Halving the
distance to what has been tried around an incumbent finds such a maximum as well as any other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

DIRECTIONS = 16
FINEST_STEP = 1e-7
"""Steps below this share of the side are not worth a trial."""
BEHIND = 0.5
"""Length of the mean of the unit vectors to the neighbours above which they all lie behind a point, on a slope."""
CONE = 0.5
"""Cosine of the half angle within which a tried point stands in the way ahead."""
LONGEST_STRIDE = 4.0
"""Of a step up a slope, in steps that stay among the neighbours."""


def polish(
    U: FloatArray,
    y: FloatArray,
    incumbents: npt.NDArray[np.int64],
    top: float,
    resolution: float,
    rng: np.random.Generator,
) -> FloatArray | None:
    """Return a point beside the incumbent that promises most, shape (d,); None if none promises anything.

    What an incumbent may gain is taken to be as much as the function falls from it to its 2 d nearest neighbours: on
    a cusp that is about right, on a smooth summit too much. The step is half as far as the 2 d-th of them, so it is
    halved when about that many trials around have not been better, and goes where the neighbours leave most room; in
    one dimension that halves the larger side of the bracket. Where they all lie behind it, the incumbent stands on a
    slope: then the step goes on uphill, half way to what is tried there but at most ``LONGEST_STRIDE`` times as far,
    and promises more in proportion.

    Args:
        U: tried points, shape (n, d), unit cube.
        y: their values, shape (n,).
        incumbents: indices of incumbents; those with a better value among their 4 d nearest are left out, for
            a model that does not fit sees basins where there are none.
        top: level that an incumbent must promise to reach.
        resolution: a gain that is too small to matter.
        rng: draws directions.
    """
    dim = U.shape[1]
    if len(incumbents) == 0 or len(U) <= 4 * dim:
        return None
    gaps = np.linalg.norm(U[incumbents][:, None] - U[None], axis=2)
    near = np.argsort(gaps, axis=1)[:, : 4 * dim + 1]
    own = y[incumbents]
    gain = own - np.mean(y[near[:, 1 : 2 * dim + 1]], axis=1)
    steps = 0.5 * np.take_along_axis(gaps, near, axis=1)[:, 2 * dim]
    strides = [_uphill(U, i, near[k, 1 : 2 * dim + 1], LONGEST_STRIDE * steps[k]) for k, i in enumerate(incumbents)]
    lengths = np.linalg.norm(strides, axis=1)
    on_slope = lengths > steps
    gain[on_slope] = (gain * lengths)[on_slope] / steps[on_slope]
    real = own >= np.max(y[near], axis=1)
    worth = real & (own + gain >= top) & (gain > resolution) & (np.maximum(lengths, steps) >= FINEST_STEP)
    if not np.any(worth):
        return None
    most = int(np.argmax(np.where(worth, gain, -np.inf)))
    best = U[incumbents[most]]
    return np.clip(best + strides[most], 0.0, 1.0) if on_slope[most] else _beside(best, float(steps[most]), U, rng)


def _beside(best: FloatArray, step: float, U: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Of random points a step away from ``best``, shape (d,), the farthest from all tried points U, shape (n, d)."""
    directions = rng.standard_normal((DIRECTIONS, len(best)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.clip(best + step * directions, 0.0, 1.0)
    room = np.min(np.linalg.norm(points[:, None] - U[None], axis=2), axis=1)
    point: FloatArray = points[int(np.argmax(room))]
    return point


def _uphill(U: FloatArray, index: int, neighbours: npt.NDArray[np.int64], longest: float) -> FloatArray:
    """The step, shape (d,), away from neighbours that all lie behind a point; zero if they lie around it.

    Args:
        U: tried points, shape (n, d), unit cube.
        index: of the point.
        neighbours: indices of the nearest ones.
        longest: length of a step at most.
    """
    away = -np.mean(_units(U[neighbours] - U[index]), axis=0)
    length = float(np.linalg.norm(away))
    if length <= BEHIND:
        return np.zeros(U.shape[1])
    away /= length
    moving = away != 0.0
    border = float(np.min((np.where(away > 0.0, 1.0, 0.0) - U[index])[moving] / away[moving]))
    offsets = U - U[index]
    ahead = offsets[_units(offsets) @ away > CONE]
    in_the_way = float(np.min(np.linalg.norm(ahead, axis=1), initial=np.inf))
    return away * min(0.5 * in_the_way, longest, border)


def _units(offsets: FloatArray) -> FloatArray:
    """Offsets, shape (n, d), at length 1; those of length 0 stay."""
    lengths = np.linalg.norm(offsets, axis=1, keepdims=True)
    units: FloatArray = offsets / np.where(lengths > 0.0, lengths, 1.0)
    return units
