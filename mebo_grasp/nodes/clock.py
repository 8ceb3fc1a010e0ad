"""Stamps that identify trials: unique, strictly increasing, as near to the time of day as that allows."""

from __future__ import annotations

import secrets
from collections.abc import Callable

LARGEST_OFFSET = 1_000_000
"""Nanoseconds."""


def random_offset() -> int:
    """Return some nanoseconds, below a millisecond, by which the stamps of one process lie ahead.

    Simulated time stands still between two ticks and begins anew: two optimizers, or one that was restarted,
    would give different trials the same stamp. It names trials only and has no part in what is tried.
    """
    return secrets.randbelow(LARGEST_OFFSET)


class StampSource:
    """Gives strictly increasing stamps.

    Args:
        now_ns: returns the present time in nanoseconds; it may stand still or jump back (simulated time).
        after_ns: the first stamp is greater than this.
        offset_ns: added to the present time.
    """

    def __init__(self, now_ns: Callable[[], int], after_ns: int = 0, offset_ns: int = 0) -> None:
        self._now_ns = now_ns
        self._offset = offset_ns
        self._last = after_ns

    def __call__(self) -> int:
        """Return a stamp in nanoseconds that is greater than every one before."""
        self._last = max(self._now_ns() + self._offset, self._last + 1)
        return self._last
