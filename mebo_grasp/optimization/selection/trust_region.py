"""Trust regions with the length dynamics of TuRBO (Eriksson et al. 2019, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol

INITIAL_LENGTH, MAX_LENGTH, MIN_LENGTH = 0.8, 1.6, 2.0**-7
SUCCESS_TOLERANCE = 3
MIN_IMPROVEMENT = 1e-3
"""Improvement that counts as success, as a share of the incumbent's magnitude (TuRBO's code)."""


@dataclass(frozen=True)
class TrustRegion:
    """Side length of a box in the unit cube, and what lets it grow or shrink.

    Args:
        length: base side length; the sides of the box are this times the relative lengthscales.
        successes: improvements in a row.
        failures: rounds without improvement in a row.
    """

    length: float = INITIAL_LENGTH
    successes: int = 0
    failures: int = 0

    def after(self, improved: bool, failure_tolerance: int) -> TrustRegion:
        """Return the region after a round: doubled after 3 successes, halved after enough failures.

        A region shorter than ``MIN_LENGTH`` starts again at the initial length.
        """
        successes = self.successes + 1 if improved else 0
        failures = 0 if improved else self.failures + 1
        length = self.length
        if successes >= SUCCESS_TOLERANCE:
            length, successes = min(2.0 * length, MAX_LENGTH), 0
        elif failures >= failure_tolerance:
            length, failures = length / 2.0, 0
        if length < MIN_LENGTH:
            return TrustRegion()
        return replace(self, length=length, successes=successes, failures=failures)

    def box(self, centre: FloatArray, lengthscales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Corners, shape (d,) each: longer where the function varies less, same volume, cut to the cube."""
        relative = lengthscales / np.exp(np.mean(np.log(lengthscales)))
        half = 0.5 * self.length * relative
        return np.clip(centre - half, 0.0, 1.0), np.clip(centre + half, 0.0, 1.0)


def improves(value: float, incumbent: float) -> bool:
    """Whether a value counts as success."""
    return value > incumbent + MIN_IMPROVEMENT * abs(incumbent)


def candidates_in_box(lower: FloatArray, upper: FloatArray, centre: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Sobol candidates of which, in high dimension, only about 20 coordinates differ from the centre.

    Returns:
        Points, shape (min(5000, max(2000, 200 d)), d), the numbers of TuRBO's code.
    """
    dim = len(centre)
    count = min(5000, max(2000, 200 * dim))
    points = lower + (upper - lower) * sobol(count, dim, rng)
    share = min(20.0 / dim, 1.0)
    if share < 1.0:
        moved = rng.random((count, dim)) <= share
        moved[np.arange(count), rng.integers(0, dim, count)] = True
        points = np.where(moved, points, centre)
    return points
