"""The ten simple functions of the CEC 2013 niching suite (problems 1 to 10), all to be maximized.

Source: Li, Engelbrecht and Epitropakis, "Benchmark functions for CEC'2013 special session and
competition on niching methods for multimodal function optimization", RMIT technical report, 2013,
section 2. Every function takes points of shape (n, d) and returns values of shape (n,).
"""

from __future__ import annotations

import numpy as np

from mebo_grasp.grasp import FloatArray

# Five-uneven-peak trap: corners of the piecewise linear profile, from peak to valley to peak.
_TRAP_X = np.array([0.0, 2.5, 5.0, 7.5, 12.5, 17.5, 22.5, 27.5, 30.0])
_TRAP_Y = np.array([200.0, 0.0, 160.0, 0.0, 140.0, 0.0, 160.0, 0.0, 200.0])

RASTRIGIN_PEAKS = np.array([3.0, 4.0])
"""Number of peaks along each axis of the modified Rastrigin function."""


def five_uneven_peak_trap(X: FloatArray) -> FloatArray:
    """Problem 1: two optima of 200 at the ends of [0, 30], three lower peaks between them."""
    return np.asarray(np.interp(X[:, 0], _TRAP_X, _TRAP_Y), dtype=np.float64)


def equal_maxima(X: FloatArray) -> FloatArray:
    """Problem 2: five equal, evenly spaced peaks of height 1 on [0, 1]."""
    return np.asarray(np.sin(5.0 * np.pi * X[:, 0]) ** 6)


def uneven_maxima(X: FloatArray) -> FloatArray:
    """Problem 3: one optimum of height 1 and four falling, unevenly spaced peaks on [0, 1]."""
    x = X[:, 0]
    envelope = np.exp(-2.0 * np.log(2.0) * ((x - 0.08) / 0.854) ** 2)
    return np.asarray(envelope * np.sin(5.0 * np.pi * (x**0.75 - 0.05)) ** 6)


def himmelblau(X: FloatArray) -> FloatArray:
    """Problem 4: four optima of 200 on [-6, 6]^2."""
    x, y = X.T
    return np.asarray(200.0 - (x**2 + y - 11.0) ** 2 - (x + y**2 - 7.0) ** 2)


def six_hump_camel(X: FloatArray) -> FloatArray:
    """Problem 5: two optima of 1.0316 and four local ones on [-1.9, 1.9] x [-1.1, 1.1]."""
    x, y = X.T
    return np.asarray(-((4.0 - 2.1 * x**2 + x**4 / 3.0) * x**2 + x * y + (4.0 * y**2 - 4.0) * y**2))


def shubert_profile(x: FloatArray) -> FloatArray:
    """One factor of the Shubert function, any shape in and the same shape out."""
    j = np.arange(1.0, 6.0)
    return np.asarray(np.sum(j * np.cos((j + 1.0) * x[..., None] + j), axis=-1))


def shubert(X: FloatArray) -> FloatArray:
    """Problems 6 and 8: d * 3^d optima in close groups on [-10, 10]^d."""
    return np.asarray(-np.prod(shubert_profile(X), axis=1))


def vincent(X: FloatArray) -> FloatArray:
    """Problems 7 and 9: 6^d equal optima on [0.25, 10]^d whose spacing grows with the coordinate."""
    return np.asarray(np.mean(np.sin(10.0 * np.log(X)), axis=1))


def modified_rastrigin(X: FloatArray) -> FloatArray:
    """Problem 10: 3 x 4 equal optima of -2 on [0, 1]^2."""
    return np.asarray(-np.sum(10.0 + 9.0 * np.cos(2.0 * np.pi * RASTRIGIN_PEAKS * X), axis=1))
