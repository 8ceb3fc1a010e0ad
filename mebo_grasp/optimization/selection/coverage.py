"""Expected coverage improvement: diverse points above a threshold (Malkomes et al. 2021, section 4).

A place counts as covered when a tried point lies within radius r of it. A new point is worth the expected
volume, within r of it, of places that are good (value at or above the threshold) and not yet covered.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.posterior import Posterior


def ball_offsets(count: int, dim: int, rng: np.random.Generator) -> FloatArray:
    """Points uniform in the unit ball, shape (count, dim)."""
    directions = rng.standard_normal((count, dim))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    offsets: FloatArray = directions * rng.random((count, 1)) ** (1.0 / dim)
    return offsets


def ball_reach(radius: float, sides: FloatArray) -> FloatArray:
    """How far a ball reaches along each side of the cube, shape (d,): all the way where a side counts nothing.

    Args:
        radius: of the ball.
        sides: lengths of the cube's sides in which distances count, shape (d,).
    """
    return np.divide(radius, sides, out=np.ones_like(sides), where=sides > 0.0)


def expected_coverage_improvement(
    posterior: Posterior,
    candidates: FloatArray,
    offsets: FloatArray,
    tried: FloatArray,
    threshold: float,
    sides: FloatArray,
    radius: float,
) -> FloatArray:
    """Expected share of each candidate's ball that is good, inside the cube and not covered yet.

    Args:
        posterior: the surrogate.
        candidates: shape (m, d), unit cube.
        offsets: points of the unit ball, shape (s, d); the integral is their mean.
        tried: points tried or being tried, shape (k, d).
        threshold: least good value, units of y.
        sides: lengths of the cube's sides in which distances count, shape (d,).
        radius: of the balls.

    Returns:
        Shape (m,), each in [0, 1].
    """
    places = candidates[:, None, :] + offsets[None] * ball_reach(radius, sides)
    flat = places.reshape(-1, candidates.shape[1])
    open_places = np.all((flat >= 0.0) & (flat <= 1.0), axis=1)
    for point in tried:
        open_places &= np.linalg.norm((flat - point) * sides, axis=1) >= radius
    worth = np.zeros(len(flat))
    if np.any(open_places):
        mean, sd = posterior.predict(flat[open_places])
        worth[open_places] = ndtr((mean - threshold) / sd)
    share: FloatArray = worth.reshape(len(candidates), len(offsets)).mean(axis=1)
    return share
