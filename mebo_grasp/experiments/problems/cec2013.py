"""The 20 problems of the CEC 2013 niching suite, by name and by number.

Names, boxes, optimum values, numbers of optima and niche radii as in the technical report of the
special session (Li, Engelbrecht and Epitropakis, RMIT, 2013, table 1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import compositions, landscapes, optima
from mebo_grasp.experiments.problems.problem import Problem, VectorFunction
from mebo_grasp.grasp import FloatArray

THESIS_FUNCTIONS = (
    "uneven_maxima",
    "five_uneven_peak_trap",
    "equal_maxima",
    "himmelblau",
    "modified_rastrigin",
    "vincent_2d",
)
"""The six functions of the thesis, table 7.1, in its order."""

_COMPOSITIONS = {
    "cf1_2d": 11,
    "cf2_2d": 12,
    "cf3_2d": 13,
    "cf3_3d": 14,
    "cf4_3d": 15,
    "cf3_5d": 16,
    "cf4_5d": 17,
    "cf3_10d": 18,
    "cf4_10d": 19,
    "cf4_20d": 20,
}

_Simple = tuple[int, VectorFunction, Callable[[], FloatArray], tuple[float, ...], tuple[float, ...], float, float]
# number, function, optima, lower, upper, optimum value, niche radius
_SIMPLE: dict[str, _Simple] = {
    "five_uneven_peak_trap": (
        1, landscapes.five_uneven_peak_trap, optima.five_uneven_peak_trap, (0.0,), (30.0,), 200.0, 0.01,
    ),
    "equal_maxima": (2, landscapes.equal_maxima, optima.equal_maxima, (0.0,), (1.0,), 1.0, 0.01),
    "uneven_maxima": (3, landscapes.uneven_maxima, optima.uneven_maxima, (0.0,), (1.0,), 1.0, 0.01),
    "himmelblau": (4, landscapes.himmelblau, optima.himmelblau, (-6.0, -6.0), (6.0, 6.0), 200.0, 0.01),
    "six_hump_camel": (
        5, landscapes.six_hump_camel, optima.six_hump_camel, (-1.9, -1.1), (1.9, 1.1), 1.031628453489877, 0.5,
    ),
    "shubert_2d": (
        6, landscapes.shubert, lambda: optima.shubert(2), (-10.0,) * 2, (10.0,) * 2, 186.7309088310239, 0.5,
    ),
    "vincent_2d": (7, landscapes.vincent, lambda: optima.vincent(2), (0.25,) * 2, (10.0,) * 2, 1.0, 0.2),
    "shubert_3d": (
        8, landscapes.shubert, lambda: optima.shubert(3), (-10.0,) * 3, (10.0,) * 3, 2709.093505572820, 0.5,
    ),
    "vincent_3d": (9, landscapes.vincent, lambda: optima.vincent(3), (0.25,) * 3, (10.0,) * 3, 1.0, 0.2),
    "modified_rastrigin": (
        10, landscapes.modified_rastrigin, optima.modified_rastrigin, (0.0, 0.0), (1.0, 1.0), -2.0, 0.01,
    ),
}  # fmt: skip

_NUMBERS = {name: entry[0] for name, entry in _SIMPLE.items()} | _COMPOSITIONS
ALL_FUNCTIONS = tuple(sorted(_NUMBERS, key=_NUMBERS.__getitem__))
"""The names of all 20 problems, in the order of their numbers."""

_ALIASES = {"vincent": "vincent_2d", "shubert": "shubert_2d", "rastrigin": "modified_rastrigin"}
_GROUPS = {"thesis": THESIS_FUNCTIONS, "all": ALL_FUNCTIONS}


def _composition_problem(name: str) -> Problem:
    family, _, dim_text = name.partition("_")
    dim = int(dim_text.removesuffix("d"))
    function, positions = compositions.as_function(family.upper(), dim)
    box = np.full(dim, compositions.BOX)
    return Problem(name, _COMPOSITIONS[name], dim, -box, box, len(positions), 0.0, 0.01, function, positions)


def get_problem(name: str) -> Problem:
    """Build a problem by its name, an alias or its number, e.g. ``vincent_2d``, ``vincent`` or ``7``.

    Raises:
        InvalidSettingsError: there is no such problem.
    """
    key = _ALIASES.get(name, name)
    if key.isdecimal() and 1 <= int(key) <= len(ALL_FUNCTIONS):
        key = ALL_FUNCTIONS[int(key) - 1]
    if key in _COMPOSITIONS:
        return _composition_problem(key)
    if key not in _SIMPLE:
        raise InvalidSettingsError(f"function must be one of {', '.join(ALL_FUNCTIONS)}, got {name!r}")
    number, function, positions, lower, upper, value, radius = _SIMPLE[key]
    known = positions()
    return Problem(
        key, number, len(lower), np.array(lower), np.array(upper), len(known), value, radius, function, known
    )


def select_problems(names: Iterable[str]) -> list[Problem]:
    """Build the problems that a list of names, numbers, ``thesis`` or ``all`` stands for, without repeats.

    Raises:
        InvalidSettingsError: a name is unknown.
    """
    chosen: dict[str, Problem] = {}
    for name in names:
        for member in _GROUPS.get(name, (name,)):
            problem = get_problem(member)
            chosen.setdefault(problem.name, problem)
    return list(chosen.values())
