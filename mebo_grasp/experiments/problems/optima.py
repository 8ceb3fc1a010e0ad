"""Positions of the global optima of problems 1 to 10, in closed form or refined to machine precision."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import fsolve, minimize, minimize_scalar

from mebo_grasp.experiments.problems import landscapes
from mebo_grasp.grasp import FloatArray


def _grid(axes: list[FloatArray]) -> FloatArray:
    return np.array(list(product(*axes)), dtype=np.float64)


def five_uneven_peak_trap() -> FloatArray:
    """Both ends of the interval, shape (2, 1)."""
    return np.array([[0.0], [30.0]])


def equal_maxima() -> FloatArray:
    """Odd multiples of 0.1, where the sine is 1 or -1, shape (5, 1)."""
    return np.array([[0.1], [0.3], [0.5], [0.7], [0.9]])


def uneven_maxima() -> FloatArray:
    """The first peak; the envelope moves it slightly off the sine's own maximum, shape (1, 1)."""
    # The logarithm is well conditioned at the peak; the bracket holds no other peak.
    found = minimize_scalar(
        lambda x: -np.log(landscapes.uneven_maxima(np.array([[x]]))[0]),
        bounds=(0.06, 0.1),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return np.array([[float(found.x)]])


def himmelblau() -> FloatArray:
    """The four real solutions of x^2 + y = 11, x + y^2 = 7, shape (4, 2)."""
    starts = [(3.0, 2.0), (-2.8, 3.1), (-3.8, -3.3), (3.6, -1.8)]
    solutions = [
        fsolve(lambda p: (p[0] ** 2 + p[1] - 11.0, p[0] + p[1] ** 2 - 7.0), start, xtol=1e-13) for start in starts
    ]
    return np.array(solutions, dtype=np.float64)


def six_hump_camel() -> FloatArray:
    """A pair that mirror one another through the origin, shape (2, 2)."""
    found = minimize(
        lambda p: -landscapes.six_hump_camel(p[None, :])[0],
        [0.09, -0.71],
        method="BFGS",
        options={"gtol": 1e-10},
    )
    return np.array([found.x, -found.x])


def _shubert_axis_extrema() -> tuple[FloatArray, FloatArray]:
    """Positions of the highest and of the lowest values of one Shubert factor on [-10, 10], three each."""
    grid = np.linspace(-10.0, 10.0, 20001)
    values = landscapes.shubert_profile(grid)
    extrema = []
    for sign in (1.0, -1.0):
        rising = np.flatnonzero(
            (sign * values[1:-1] >= sign * values[:-2]) & (sign * values[1:-1] >= sign * values[2:])
        )
        peaks = grid[rising + 1]
        best = np.max(sign * landscapes.shubert_profile(peaks))
        peaks = peaks[sign * landscapes.shubert_profile(peaks) > best - 1e-3]
        refined = [
            minimize_scalar(
                lambda x, s=sign: -s * landscapes.shubert_profile(np.array(x)),
                bounds=(p - 2e-3, p + 2e-3),
                method="bounded",
                options={"xatol": 1e-12},
            ).x
            for p in peaks
        ]
        extrema.append(np.array(refined, dtype=np.float64))
    return extrema[0], extrema[1]


def shubert(dim: int) -> FloatArray:
    """All products of an odd number of lowest factors that reach the optimum, shape (dim * 3^dim, dim).

    The highest factor (14.508) exceeds the lowest (-12.871) in size, so the negated product is
    greatest with exactly one lowest factor.
    """
    highest, lowest = _shubert_axis_extrema()
    points = [_grid([lowest if axis == negative else highest for axis in range(dim)]) for negative in range(dim)]
    return np.concatenate(points)


def vincent(dim: int) -> FloatArray:
    """The grid over x = exp((pi/2 + 2 pi k) / 10), k = -2 .. 3, shape (6^dim, dim)."""
    axis = np.exp((np.pi / 2.0 + 2.0 * np.pi * np.arange(-2, 4)) / 10.0)
    return _grid([axis] * dim)


def modified_rastrigin() -> FloatArray:
    """The grid over (2 m + 1) / (2 k), k peaks an axis, shape (12, 2)."""
    return _grid([(2.0 * np.arange(k) + 1.0) / (2.0 * k) for k in landscapes.RASTRIGIN_PEAKS])
