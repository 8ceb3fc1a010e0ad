"""The composition functions CF1 to CF4 of the CEC 2013 niching suite (problems 11 to 20).

A composition is a weighted mean of shifted, stretched and rotated basic functions, each of which
has its optimum, 0, at its own shift. Source: Li, Engelbrecht and Epitropakis, RMIT technical report,
2013, section 2.2. Shifts and rotations are the competition's data (``data/NOTICE``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems.problem import VectorFunction
from mebo_grasp.grasp import FloatArray

SCALE = 2000.0
"""C: the height every basic function is stretched to."""
BOX = 5.0
"""The compositions live on [-BOX, BOX]^d."""
_DATA_FILE = "data/cec2013_compositions.npz"


def sphere(Z: FloatArray) -> FloatArray:
    """Sum of squares, (n, d) to (n,)."""
    return np.asarray(np.sum(Z**2, axis=1))


def rastrigin(Z: FloatArray) -> FloatArray:
    """Rastrigin's function, (n, d) to (n,)."""
    return np.asarray(np.sum(Z**2 - 10.0 * np.cos(2.0 * np.pi * Z) + 10.0, axis=1))


def griewank(Z: FloatArray) -> FloatArray:
    """Griewank's function, (n, d) to (n,)."""
    roots = np.sqrt(np.arange(1.0, Z.shape[1] + 1.0))
    return np.asarray(np.sum(Z**2, axis=1) / 4000.0 - np.prod(np.cos(Z / roots), axis=1) + 1.0)


def weierstrass(Z: FloatArray) -> FloatArray:
    """Weierstrass' function with a = 0.5, b = 3, 21 terms, (n, d) to (n,)."""
    k = np.arange(21)
    amplitude, frequency = 0.5**k, 2.0 * np.pi * 3.0**k
    terms = np.cos((Z[..., None] + 0.5) * frequency) @ amplitude
    return np.asarray(np.sum(terms, axis=1) - Z.shape[1] * np.sum(amplitude * np.cos(frequency * 0.5)))


def expanded_griewank_rosenbrock(Z: FloatArray) -> FloatArray:
    """EF8F2, Griewank of Rosenbrock over neighbours, with its optimum moved to 0, (n, d) to (n,)."""
    left = Z + 1.0
    right = np.roll(left, -1, axis=1)
    rosenbrock = 100.0 * (left**2 - right) ** 2 + (left - 1.0) ** 2
    return np.asarray(np.sum(rosenbrock**2 / 4000.0 - np.cos(rosenbrock) + 1.0, axis=1))


BasicFunction = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class CompositionRecipe:
    """What a composition is made of: basic functions, widths sigma, stretches lambda, rotated or not."""

    functions: tuple[BasicFunction, ...]
    sigma: tuple[float, ...]
    stretch: tuple[float, ...]
    rotated: bool


def _pairs(*functions: BasicFunction) -> tuple[BasicFunction, ...]:
    return tuple(function for function in functions for _ in range(2))


RECIPES: dict[str, CompositionRecipe] = {
    "CF1": CompositionRecipe(
        _pairs(griewank, weierstrass, sphere), (1.0,) * 6, (1.0, 1.0, 8.0, 8.0, 1 / 5, 1 / 5), rotated=False
    ),
    "CF2": CompositionRecipe(
        _pairs(rastrigin, weierstrass, griewank, sphere),
        (1.0,) * 8,
        (1.0, 1.0, 10.0, 10.0, 1 / 10, 1 / 10, 1 / 7, 1 / 7),
        rotated=False,
    ),
    "CF3": CompositionRecipe(
        _pairs(expanded_griewank_rosenbrock, weierstrass, griewank),
        (1.0, 1.0, 2.0, 2.0, 2.0, 2.0),
        (1 / 4, 1 / 10, 2.0, 1.0, 2.0, 5.0),
        rotated=True,
    ),
    "CF4": CompositionRecipe(
        _pairs(rastrigin, expanded_griewank_rosenbrock, weierstrass, griewank),
        (1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0),
        (4.0, 1.0, 4.0, 1.0, 1 / 10, 1 / 5, 1 / 10, 1 / 40),
        rotated=True,
    ),
}


@lru_cache(maxsize=1)
def _competition_data() -> dict[str, FloatArray]:
    resource = files("mebo_grasp.experiments.problems") / _DATA_FILE
    with resource.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {key: np.array(archive[key], dtype=np.float64) for key in archive.files}


@dataclass(frozen=True, eq=False)
class Composition:
    """One composition function in one dimension; call it with points of shape (n, d).

    Args:
        recipe: the parts.
        shifts: optima of the parts, shape (m, d).
        rotations: one orthogonal matrix a part, shape (m, d, d).
    """

    recipe: CompositionRecipe
    shifts: FloatArray
    rotations: FloatArray
    _heights: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        corner = np.full((1, self.shifts.shape[1]), BOX)
        heights = [
            abs(float(function((corner / stretch) @ rotation)[0]))
            for function, stretch, rotation in zip(
                self.recipe.functions, self.recipe.stretch, self.rotations, strict=True
            )
        ]
        object.__setattr__(self, "_heights", np.array(heights))

    def weights(self, X: FloatArray) -> FloatArray:
        """Share of each part at points of shape (n, d), shape (n, m); rows sum to 1."""
        squared = np.sum((X[:, None, :] - self.shifts) ** 2, axis=2)
        w = np.exp(-squared / (2.0 * X.shape[1] * np.array(self.recipe.sigma) ** 2))
        largest = np.max(w, axis=1, keepdims=True)
        w = np.where(w == largest, w, w * (1.0 - largest**10))
        total = np.sum(w, axis=1, keepdims=True)
        # Far from every shift all weights underflow to 0; the suite then weighs the parts alike.
        return np.asarray(np.where(total > 0.0, w / np.where(total > 0.0, total, 1.0), 1.0 / w.shape[1]))

    def __call__(self, X: FloatArray) -> FloatArray:
        """Values at points of shape (n, d), shape (n,); 0 at every shift, negative elsewhere."""
        parts = [
            SCALE * function(((X - shift) / stretch) @ rotation) / height
            for function, shift, stretch, rotation, height in zip(
                self.recipe.functions,
                self.shifts,
                self.recipe.stretch,
                self.rotations,
                self._heights,
                strict=True,
            )
        ]
        return np.asarray(-np.sum(self.weights(X) * np.stack(parts, axis=1), axis=1))


def composition(name: str, dim: int) -> Composition:
    """Build CF1 to CF4 in a dimension for which the competition gives data.

    Args:
        name: ``CF1``, ``CF2``, ``CF3`` or ``CF4``.
        dim: number of dimensions.

    Raises:
        InvalidSettingsError: there is no such composition, or no rotation for this dimension.
    """
    if name not in RECIPES:
        raise InvalidSettingsError(f"composition must be one of {sorted(RECIPES)}, got {name!r}")
    recipe, data = RECIPES[name], _competition_data()
    parts = len(recipe.functions)
    shifts = data["optima"][:parts, :dim]
    if not recipe.rotated:
        return Composition(recipe, shifts, np.broadcast_to(np.eye(dim), (parts, dim, dim)).copy())
    key = f"{name}_M_D{dim}"
    if key not in data:
        known = sorted(int(k.rpartition("D")[2]) for k in data if k.startswith(f"{name}_M_D"))
        raise InvalidSettingsError(f"{name} has rotations for the dimensions {known}, got {dim}")
    return Composition(recipe, shifts, data[key])


def as_function(name: str, dim: int) -> tuple[VectorFunction, FloatArray]:
    """The composition and its optima, shape (m, d)."""
    built = composition(name, dim)
    return built, built.shifts
