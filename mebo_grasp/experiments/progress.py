"""What an experiment says as it goes: how far it is and how long it will take."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TextIO

_REPORT_SECONDS = 15.0


def say(text: str, stream: TextIO) -> None:
    """Write a line at once."""
    stream.write(f"{text}\n")
    stream.flush()


class Progress:
    """A line with the share done and the time left, rewritten on a terminal, printed now and then elsewhere.

    Args:
        total: number of jobs to run.
        workers: processes side by side.
        stream: where to write.
    """

    def __init__(self, total: int, workers: int, stream: TextIO) -> None:
        self._total, self._workers, self._stream = total, workers, stream
        self._begin = self._reported = time.monotonic()
        self._seconds: dict[str, list[float]] = {}
        self._done = 0

    def finished(self, kind: str, seconds: float) -> None:
        """Count a run of some kind (a cell of the experiment) and the wall time it took."""
        self._done += 1
        self._seconds.setdefault(kind, []).append(seconds)

    def seconds_left(self, waiting: Sequence[str]) -> float | None:
        """Estimate from the mean time of each kind's runs so far; None before the first run is done.

        Args:
            waiting: the kind of each job that is not done.
        """
        if not self._seconds:
            return None
        means = {kind: sum(times) / len(times) for kind, times in self._seconds.items()}
        overall = sum(means.values()) / len(means)
        return sum(means.get(kind, overall) for kind in waiting) / self._workers

    def show(self, waiting: Sequence[str], force: bool = False) -> None:
        """Write the line if it is due."""
        now = time.monotonic()
        if not force and not self._stream.isatty() and now - self._reported < _REPORT_SECONDS:
            return
        self._reported = now
        left = self.seconds_left(waiting)
        text = (
            f"{self._done}/{self._total} runs, {_clock(now - self._begin)} elapsed, "
            f"{'-' if left is None else _clock(left)} left"
        )
        self._stream.write(f"\r{text:<60}" if self._stream.isatty() else f"{text}\n")
        self._stream.flush()

    def close(self) -> None:
        """End the line on a terminal."""
        if self._stream.isatty():
            self._stream.write("\n")
            self._stream.flush()


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
