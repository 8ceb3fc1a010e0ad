"""Arrays that grow at their end."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

SPARE = 8
"""One row in so many is allocated beyond those in use: growing copies everything, and is to be rare."""


class Column:
    """An array that grows at its end without being copied each time.

    Args:
        length: rows to begin with; their values are to be written into ``array``.
        dtype: of the elements.
        width: further dimensions, such as (3,) for points.
    """

    def __init__(self, length: int, dtype: npt.DTypeLike, width: tuple[int, ...] = ()) -> None:
        self._values: npt.NDArray[Any] = np.empty((_capacity(length), *width), dtype)
        self._length = length

    @classmethod
    def of(cls, values: npt.NDArray[Any]) -> Column:
        """Return a column that holds a copy of an array."""
        column = cls(len(values), values.dtype, values.shape[1:])
        column.array[:] = values
        return column

    @classmethod
    def with_room(cls, rows: int, dtype: npt.DTypeLike, width: tuple[int, ...] = ()) -> Column:
        """Return an empty column that need not grow for so many rows."""
        column = cls(rows, dtype, width)
        column._length = 0
        return column

    def __len__(self) -> int:
        return self._length

    @property
    def array(self) -> npt.NDArray[Any]:
        """What is in it now; rows that are added at the end later do not change it."""
        return self._values[: self._length]

    def extend(self, values: npt.NDArray[Any]) -> None:
        """Add rows, shape (k, ...)."""
        needed = self._length + len(values)
        if needed > len(self._values):
            grown = np.empty((_capacity(needed), *self._values.shape[1:]), self._values.dtype)
            grown[: self._length] = self.array
            self._values = grown
        self._values[self._length : needed] = values
        self._length = needed

    def insert(self, position: int, value: Any) -> None:
        """Add one row before the row at ``position``."""
        self.extend(np.asarray([value], self._values.dtype))
        values = self.array
        values[position + 1 :] = values[position:-1].copy()
        values[position] = value


def _capacity(length: int) -> int:
    return length + length // SPARE + 64
