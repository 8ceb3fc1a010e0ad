"""The box that is searched: names, bounds and units of its dimensions, and the map to the unit cube."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray


def read_only(values: npt.ArrayLike) -> FloatArray:
    """Return a float64 copy of ``values`` that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """A box in real units.

    Args:
        names: one distinct, non-empty name a dimension.
        lower: lower bounds, shape (d,), real units.
        upper: upper bounds, shape (d,), real units, each above its lower bound.
        units: one unit a dimension for display, or empty.
        distance_weights: what a unit of each dimension counts in the distance of two points, shape (d,): 1 for
            metres and, say, 0.05 for radians gives metres. Default: 1 each.

    Raises:
        InvalidSettingsError: no dimension, lengths differ, a name is empty or repeated, a bound is not
            finite, a lower bound is not below its upper bound, or a weight is negative or not finite, or all are 0.
    """

    names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    units: tuple[str, ...] = field(default=())
    distance_weights: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        names, units = tuple(self.names), tuple(self.units)
        lower, upper = read_only(self.lower), read_only(self.upper)
        self._check_names(names, units)
        self._check_bounds(names, lower, upper)
        weights = read_only(self.distance_weights if np.size(self.distance_weights) else np.ones(len(names)))
        self._check_weights(names, weights)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "units", units)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        object.__setattr__(self, "distance_weights", weights)

    @staticmethod
    def _check_names(names: tuple[str, ...], units: tuple[str, ...]) -> None:
        if not names:
            raise InvalidSettingsError("a search space needs at least one dimension, got none")
        if any(not name for name in names) or len(set(names)) != len(names):
            raise InvalidSettingsError(f"dimension names must be distinct and not empty, got {names}")
        if units and len(units) != len(names):
            raise InvalidSettingsError(f"give one unit a dimension or none: {len(names)} names, {len(units)} units")

    @staticmethod
    def _check_bounds(names: tuple[str, ...], lower: FloatArray, upper: FloatArray) -> None:
        expected = (len(names),)
        if lower.shape != expected or upper.shape != expected:
            raise InvalidSettingsError(
                f"bounds must have shape {expected} for {names}, got lower {lower.shape}, upper {upper.shape}"
            )
        for name, low, high in zip(names, lower, upper, strict=True):
            # Python floats: their difference overflows to infinity without a warning.
            if not np.isfinite(float(high) - float(low)):
                raise InvalidSettingsError(f"bounds of {name} must be finite, got [{low}, {high}]")
            if low >= high:
                raise InvalidSettingsError(
                    f"lower bound {low} of {name} must be below its upper bound {high}; swap or widen them"
                )

    @staticmethod
    def _check_weights(names: tuple[str, ...], weights: FloatArray) -> None:
        if weights.shape != (len(names),):
            raise InvalidSettingsError(
                f"give one distance weight a dimension or none: {len(names)} names, weights of shape {weights.shape}"
            )
        if not np.all(np.isfinite(weights) & (weights >= 0.0)) or not np.any(weights > 0.0):
            raise InvalidSettingsError(
                f"distance weights must be finite and at least 0, one above 0, got {weights.tolist()}"
            )

    @classmethod
    def unit_cube(cls, dim: int) -> SearchSpace:
        """Return [0, 1]^dim with names x0, x1 and so on."""
        return cls(tuple(f"x{i}" for i in range(dim)), np.zeros(dim), np.ones(dim))

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return len(self.names)

    @property
    def weighted_sides(self) -> FloatArray:
        """Lengths of the box's sides, shape (d,), in which distances count: unit-cube points times these."""
        sides: FloatArray = (self.upper - self.lower) * self.distance_weights
        return sides

    def to_unit(self, x: npt.ArrayLike) -> FloatArray:
        """Map real-unit points, shape (..., d), into the unit cube; points outside the box are clipped."""
        scaled = (np.asarray(x, dtype=np.float64) - self.lower) / (self.upper - self.lower)
        unit: FloatArray = np.clip(scaled, 0.0, 1.0)
        return unit

    def from_unit(self, u: npt.ArrayLike) -> FloatArray:
        """Map unit-cube points, shape (..., d), to real units; the result never leaves the box."""
        u = np.asarray(u, dtype=np.float64)
        # The convex combination hits both bounds exactly; lower + u * range may miss the upper by rounding.
        x: FloatArray = np.clip((1.0 - u) * self.lower + u * self.upper, self.lower, self.upper)
        return x

    def contains(self, x: npt.ArrayLike) -> bool:
        """Whether a real-unit point, shape (d,), is finite and lies in the box, bounds included."""
        point = np.asarray(x, dtype=np.float64)
        if point.shape != (self.dim,) or not np.all(np.isfinite(point)):
            return False
        return bool(np.all(point >= self.lower) and np.all(point <= self.upper))
