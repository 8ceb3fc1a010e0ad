"""How far a robot may miss the point that it is told: zero-mean noise of a query, in the units that are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.search_space import SearchSpace

CUBE, SPACE, POSE = "cube", "space", "pose"
UNITS = (CUBE, SPACE, POSE)
_LENGTH, _ANGLE = "m", "rad"


@dataclass(frozen=True)
class InputNoise:
    """Zero-mean noise of the inputs, given in one of three units.

    Args:
        values: in ``cube`` (sides of the unit cube) and ``space`` (real units of the search space): one
            standard deviation for all dimensions, or d of them, or a covariance as d rows, flattened to d²
            numbers. In ``pose``: the standard deviation of lengths [m] and of angles [rad]; dimensions
            with another unit are taken as exact.
        unit: one of ``UNITS``.
        kappa: parameter k of the unscented transform; None for 3 - d, but at least 0, so that no weight is negative,
            and at most 1, so that in one dimension the point itself counts no more than its two neighbours. The
            default method draws the noise instead and needs no k.

    Raises:
        InvalidSettingsError: unknown unit, no values, a value that is not finite, a negative deviation, or a
            wrong count of values for ``pose``.
    """

    values: tuple[float, ...]
    unit: str = CUBE
    kappa: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        if self.unit not in UNITS:
            raise InvalidSettingsError(f"the unit of input noise must be one of {', '.join(UNITS)}, got {self.unit!r}")
        if not self.values or not np.all(np.isfinite(self.values)):
            raise InvalidSettingsError(f"input noise needs one or more finite values, got {self.values}")
        if self.unit == POSE and (len(self.values) != 2 or min(self.values) < 0.0):
            raise InvalidSettingsError(
                f"input noise of a pose has two standard deviations >= 0, in metres and in radians, got {self.values}"
            )
        if self.kappa is not None and not np.isfinite(self.kappa):
            raise InvalidSettingsError(f"kappa must be finite or unset, got {self.kappa}")

    @classmethod
    def covariance(cls, matrix: npt.ArrayLike, unit: str = CUBE, kappa: float | None = None) -> Self:
        """Full covariance, shape (d, d), in ``cube`` or ``space`` units.

        Raises:
            InvalidSettingsError: it is not square, or the variance of a single dimension is negative.
        """
        square = np.asarray(matrix, dtype=np.float64)
        if square.ndim != 2 or square.shape[0] != square.shape[1]:
            raise InvalidSettingsError(f"a covariance must have shape (d, d), got {square.shape}")
        if len(square) > 1:
            return cls(tuple(square.ravel().tolist()), unit, kappa)
        # One value alone is a standard deviation.
        if square[0, 0] < 0.0:
            raise InvalidSettingsError(f"a variance must be at least 0, got {square[0, 0]}")
        return cls((float(np.sqrt(square[0, 0])),), unit, kappa)

    @classmethod
    def of_pose(cls, metres: float, radians: float, kappa: float | None = None) -> Self:
        """The same standard deviation for all lengths [m], and for all angles [rad]."""
        return cls((metres, radians), POSE, kappa)

    @classmethod
    def from_json(cls, value: Any) -> Self:
        """Read back what ``dataclasses.asdict`` and JSON made of it.

        Raises:
            InvalidSettingsError: it is no such record, or a value is out of its range.
        """
        if not isinstance(value, dict) or not set(value) <= {"values", "unit", "kappa"}:
            raise InvalidSettingsError(f"input noise must have values, unit and kappa, got {value!r}")
        try:
            return cls(**{**value, "values": tuple(value["values"])})
        except InvalidSettingsError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidSettingsError(f"input noise is unreadable: {value!r}") from error

    def in_cube(self, space: SearchSpace) -> FloatArray:
        """Covariance in sides of the unit cube, shape (d, d).

        Raises:
            InvalidSettingsError: the number of values does not fit the space, a deviation is negative, or a
                matrix is no covariance.
        """
        dim = space.dim
        covariance = self._pose_covariance(space) if self.unit == POSE else self._matrix(dim)
        if self.unit != CUBE:
            sides = space.upper - space.lower
            covariance = covariance / np.outer(sides, sides)
        return covariance

    def _pose_covariance(self, space: SearchSpace) -> FloatArray:
        if not set(space.units) & {_LENGTH, _ANGLE}:
            raise InvalidSettingsError(
                f"input noise in metres and radians needs dimensions in these units, got {space.units}"
            )
        sds = {_LENGTH: self.values[0], _ANGLE: self.values[1]}
        return np.diag([sds.get(unit, 0.0) ** 2 for unit in space.units])

    def _matrix(self, dim: int) -> FloatArray:
        values = np.array(self.values)
        if len(values) in (1, dim):
            if np.any(values < 0.0):
                raise InvalidSettingsError(f"standard deviations of the input must be at least 0, got {self.values}")
            return np.diag(np.broadcast_to(values, dim) ** 2)
        if len(values) != dim * dim:
            raise InvalidSettingsError(
                f"input noise in {dim} dimensions has 1, {dim} or {dim * dim} values, got {len(values)}"
            )
        matrix = values.reshape(dim, dim)
        size = float(np.max(np.abs(matrix)))
        if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * size) or (
            np.min(np.linalg.eigvalsh(matrix)) < -1e-9 * size
        ):
            raise InvalidSettingsError(f"a covariance must be symmetric and not negative, got {matrix.tolist()}")
        return 0.5 * (matrix + matrix.T)
