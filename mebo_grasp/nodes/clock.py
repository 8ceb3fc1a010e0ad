"""Stamps that identify trials: unique, strictly increasing, as near to the time of day as that allows."""

from __future__ import annotations

from collections.abc import Callable


class StampSource:
    """Gives strictly increasing stamps.

    Args:
        now_ns: returns the present time in nanoseconds; it may stand still or jump back (simulated time).
        after_ns: the first stamp is greater than this.
    """

    def __init__(self, now_ns: Callable[[], int], after_ns: int = 0) -> None:
        self._now_ns = now_ns
        self._last = after_ns

    def __call__(self) -> int:
        """Return a stamp in nanoseconds that is greater than every one before."""
        self._last = max(self._now_ns(), self._last + 1)
        return self._last
