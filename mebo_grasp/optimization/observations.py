"""What is known so far: valued, failed and pending points in the unit cube."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray


class GrowingArray:
    """Rows of a fixed width in one buffer that doubles when it is full, so appending costs O(1)."""

    def __init__(self, width: int) -> None:
        self._buffer = np.empty((16, width))
        self._size = 0

    def append(self, row: npt.ArrayLike) -> None:
        """Add one row, shape (width,)."""
        if self._size == len(self._buffer):
            self._buffer = np.concatenate([self._buffer, np.empty_like(self._buffer)])
        self._buffer[self._size] = row
        self._size += 1

    @property
    def rows(self) -> FloatArray:
        """Read-only view, shape (n, width); rows appended later are not part of it."""
        view = self._buffer[: self._size]
        view.flags.writeable = False
        return view


LEAST_NOISE, MOST_NOISE = 1e-7, 1.0
"""Noise variances that surrogates seek or take as known, shares of the variance of the values."""


class Observations:
    """Points with values, points whose trial failed, and points whose trial is still open.

    Args:
        dim: number of dimensions d.
    """

    def __init__(self, dim: int) -> None:
        if dim < 1:
            raise InvalidSettingsError(f"observations need at least one dimension, got {dim}")
        self._dim = dim
        self._U = GrowingArray(dim)
        self._y = GrowingArray(1)
        self._failed = GrowingArray(dim)
        self._pending: dict[int, FloatArray] = {}

    @property
    def dim(self) -> int:
        """Number of dimensions d."""
        return self._dim

    @property
    def n(self) -> int:
        """Number of points with a value."""
        return len(self._U.rows)

    @property
    def U(self) -> FloatArray:  # noqa: N802
        """Points with a value, shape (n, d), unit cube, in the order of arrival; read-only."""
        return self._U.rows

    @property
    def y(self) -> FloatArray:
        """Their values, shape (n,), larger is better; read-only."""
        return self._y.rows[:, 0]

    @property
    def failed(self) -> FloatArray:
        """Points whose trial gave no value, shape (n_failed, d), unit cube; read-only."""
        return self._failed.rows

    @property
    def pending(self) -> FloatArray:
        """Points of open trials in the order of their ids, shape (n_pending, d), unit cube; a copy."""
        if not self._pending:
            return np.empty((0, self._dim))
        return np.stack([self._pending[key] for key in sorted(self._pending)])

    @property
    def without_value(self) -> FloatArray:
        """Points that failed or are open, shape (n_failed + n_pending, d): their values are not known."""
        return np.concatenate([self.failed, self.pending])

    @property
    def taken(self) -> FloatArray:
        """Every point that was asked for or observed, in one array, shape (n + n_failed + n_pending, d)."""
        return np.concatenate([self.U, self.without_value])

    def _checked(self, u: npt.ArrayLike) -> FloatArray:
        point = np.array(u, dtype=np.float64)
        if point.shape != (self._dim,) or not np.all((point >= 0.0) & (point <= 1.0)):
            raise InvalidSettingsError(
                f"a point must have shape ({self._dim},) and lie in the unit cube, got {point.tolist()}"
            )
        return point

    def open(self, key: int, u: npt.ArrayLike) -> None:
        """Note that the trial ``key`` at ``u``, shape (d,), is being evaluated."""
        self._pending[key] = self._checked(u)

    def close(self, key: int) -> FloatArray:
        """Forget that trial ``key`` is open and return its point, shape (d,).

        Raises:
            KeyError: no such trial is open.
        """
        return self._pending.pop(key)

    def add(self, u: npt.ArrayLike, value: float) -> None:
        """Add a point, shape (d,), with its finite value.

        Raises:
            InvalidSettingsError: the point leaves the unit cube or the value is not finite.
        """
        point = self._checked(u)
        if not np.isfinite(value):
            raise InvalidSettingsError(f"the value of a trial must be finite, got {value}")
        self._U.append(point)
        self._y.append([value])

    def add_failed(self, u: npt.ArrayLike) -> None:
        """Remember a point, shape (d,), that gave no value."""
        self._failed.append(self._checked(u))
