"""Points that fill the unit cube: designs from ``scipy.stats.qmc``, and one point more beside others."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import qmc

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray

NUM_CANDIDATES = 32
"""Uniform points of which ``best_candidate`` takes one."""


def _engine(kind: Any, dim: int, rng: np.random.Generator, **options: Any) -> Any:
    # scipy spawns a child of a generator it is given, and children come from the seed, not from the state: a
    # generator restored from a log would give other points. A fresh one, seeded by a draw, does not.
    child = np.random.default_rng(int(rng.integers(2**63)))
    return kind(d=dim, **rng_argument(kind, child), **options)


def rng_argument(function: Any, rng: np.random.Generator) -> dict[str, np.random.Generator]:
    """A generator by the name under which a function of scipy takes it: rng from 1.15 on; Ubuntu 24.04 has 1.11."""
    known = inspect.signature(function).parameters
    name = next(name for name in ("rng", "seed", "random_state") if name in known)
    return {name: rng}


def _check(n: int, dim: int) -> None:
    if n < 0 or dim < 1:
        raise InvalidSettingsError(f"a design needs n >= 0 points and dim >= 1, got n={n}, dim={dim}")


def latin_hypercube(n: int, dim: int, rng: np.random.Generator) -> FloatArray:
    """Draw a Latin hypercube design: in each dimension one point in each of n equal cells.

    Returns:
        Points in the unit cube, shape (n, dim).

    Raises:
        InvalidSettingsError: n is negative or dim below 1.
    """
    _check(n, dim)
    if n == 0:
        return np.empty((0, dim))
    design: FloatArray = _engine(qmc.LatinHypercube, dim, rng).random(n)
    return np.clip(design, 0.0, 1.0)


def sobol(n: int, dim: int, rng: np.random.Generator) -> FloatArray:
    """Draw the first n points of a scrambled Sobol sequence.

    Returns:
        Points in the unit cube, shape (n, dim).

    Raises:
        InvalidSettingsError: n is negative or dim below 1.
    """
    _check(n, dim)
    if n == 0:
        return np.empty((0, dim))
    # Drawing a power of two keeps the balance properties (and scipy quiet); the surplus is cut off.
    design: FloatArray = _engine(qmc.Sobol, dim, rng, scramble=True).random_base2(max(n - 1, 0).bit_length())
    return design[:n]


def best_candidate(taken: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Of a few uniform points the one farthest from all that are taken (Mitchell 1991), shape (d,).

    Args:
        taken: points of the unit cube, shape (n, d), at least one.
        rng: source of randomness.
    """
    candidates = rng.random((NUM_CANDIDATES, taken.shape[1]))
    farthest: FloatArray = candidates[int(np.argmax(np.min(cdist(candidates, taken), axis=1)))]
    return farthest
