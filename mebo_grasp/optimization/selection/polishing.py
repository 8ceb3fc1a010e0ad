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
    one dimension that halves the larger side of the bracket.

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
    real = own >= np.max(y[near], axis=1)
    worth = real & (own + gain >= top) & (gain > resolution) & (steps >= FINEST_STEP)
    if not np.any(worth):
        return None
    most = int(np.argmax(np.where(worth, gain, -np.inf)))
    directions = rng.standard_normal((DIRECTIONS, dim))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.clip(U[incumbents[most]] + steps[most] * directions, 0.0, 1.0)
    room = np.min(np.linalg.norm(points[:, None] - U[None], axis=2), axis=1)
    point: FloatArray = points[int(np.argmax(room))]
    return point
