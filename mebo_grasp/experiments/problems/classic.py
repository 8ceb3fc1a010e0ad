"""The three 2-D functions of the thesis's table D.1, negated so that their minima are sought, and as written.

The thesis does not state the boxes. These are the usual ones (Surjanovic and Bingham, "Virtual library
of simulation experiments"); smaller boxes in use could not hold the printed variances: three points in
[-2, 2] have a variance of at most 3.6, and the table has 6.7 for the first axis of the six-hump camel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import landscapes, optima
from mebo_grasp.experiments.problems.problem import Problem
from mebo_grasp.grasp import FloatArray

BATCH_VARIANCE_FUNCTIONS = ("branin", "six_hump_camel_wide", "beale")
"""The columns of table D.1, negated: what is sought are the published minima."""
AS_WRITTEN = "_as_written"
"""Suffix of the same functions with their own sign: what is sought are their greatest values, at the box's corners."""
CLASSIC_FUNCTIONS = (*BATCH_VARIANCE_FUNCTIONS, *(name + AS_WRITTEN for name in BATCH_VARIANCE_FUNCTIONS))


def branin(X: FloatArray) -> FloatArray:
    """Branin's function, negated: three optima of -0.397887 on [-5, 10] x [0, 15]."""
    x, y = X.T
    inner = y - 5.1 * x**2 / (4.0 * np.pi**2) + 5.0 * x / np.pi - 6.0
    return np.asarray(-(inner**2 + 10.0 * (1.0 - 1.0 / (8.0 * np.pi)) * np.cos(x) + 10.0))


def beale(X: FloatArray) -> FloatArray:
    """Beale's function, negated: one optimum of 0 at (3, 0.5)."""
    x, y = X.T
    return np.asarray(-((1.5 - x + x * y) ** 2 + (2.25 - x + x * y**2) ** 2 + (2.625 - x + x * y**3) ** 2))


def _branin_optima() -> FloatArray:
    starts = [(-np.pi, 12.275), (np.pi, 2.275), (3.0 * np.pi, 2.475)]
    return np.array(
        [
            minimize(lambda p: -branin(p[None, :])[0], start, method="BFGS", options={"gtol": 1e-10}).x
            for start in starts
        ]
    )


def get_classic(name: str) -> Problem:
    """Build one of ``CLASSIC_FUNCTIONS``.

    Raises:
        InvalidSettingsError: there is no such function.
    """
    if name not in CLASSIC_FUNCTIONS:
        raise InvalidSettingsError(f"function must be one of {', '.join(CLASSIC_FUNCTIONS)}, got {name!r}")
    negated = _NEGATED[name.removesuffix(AS_WRITTEN)]()
    return _as_written(negated) if name.endswith(AS_WRITTEN) else negated


def _branin() -> Problem:
    lower, upper, at = np.array([-5.0, 0.0]), np.array([10.0, 15.0]), _branin_optima()
    return Problem("branin", 0, 2, lower, upper, 3, float(branin(at)[0]), 0.5, branin, at)


def _six_hump_camel() -> Problem:
    box, at = np.array([3.0, 2.0]), optima.six_hump_camel()
    value = float(landscapes.six_hump_camel(at)[0])
    return Problem("six_hump_camel_wide", 0, 2, -box, box, 2, value, 0.5, landscapes.six_hump_camel, at)


def _beale() -> Problem:
    box = np.array([4.5, 4.5])
    return Problem("beale", 0, 2, -box, box, 1, 0.0, 0.5, beale, np.array([[3.0, 0.5]]))


_NEGATED = {"branin": _branin, "six_hump_camel_wide": _six_hump_camel, "beale": _beale}
_HIGHEST = {
    "branin": [[-5.0, 0.0]],
    "six_hump_camel_wide": [[3.0, 2.0], [-3.0, -2.0]],
    "beale": [[-4.5, -4.5]],
}
"""Where each function as written is greatest: corners of its box."""


def _as_written(negated: Problem) -> Problem:
    """The function with its own sign, to be maximized as it stands."""

    def function(X: FloatArray) -> FloatArray:
        return -negated.function(X)

    at = np.array(_HIGHEST[negated.name])
    return replace(
        negated, name=negated.name + AS_WRITTEN, function=function,
        optima=at, n_optima=len(at), optimum_value=float(function(at)[0]),
    )  # fmt: skip
