"""What the user sees of an experiment under way."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TextIO

from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.run_costs import CostEstimate

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
        self._costs = CostEstimate()
        self._done = 0

    def announce(self, jobs: Sequence[Job]) -> None:
        """Say what is to come, before any of it has been measured."""
        seconds = self._costs.total(jobs)
        plural = "" if self._workers == 1 else "s"
        self._stream.write(
            f"{len(jobs)} runs to make, roughly {_clock(seconds)} of CPU time; "
            f"{_clock(self.seconds_left(jobs))} with {self._workers} worker{plural}\n"
        )
        self._stream.flush()

    def finished(self, job: Job, seconds: float | None) -> None:
        """Count a run that took some wall time; None if it ended in an error, which tells nothing of others."""
        self._done += 1
        if seconds is not None:
            self._costs.finished(job, seconds)

    def seconds_left(self, waiting: Sequence[Job]) -> float:
        """Estimate from the runs so far, or, before any, from what is known of the methods.

        Args:
            waiting: the jobs that are not done.
        """
        return self._costs.total(waiting) / self._workers

    def show(self, waiting: Sequence[Job], force: bool = False) -> None:
        """Write the line if it is due."""
        now = time.monotonic()
        if not force and not self._stream.isatty() and now - self._reported < _REPORT_SECONDS:
            return
        self._reported = now
        text = (
            f"{self._done}/{self._total} runs, {_clock(now - self._begin)} elapsed, "
            f"about {_clock(self.seconds_left(waiting))} left"
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
