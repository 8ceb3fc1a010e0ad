"""What a person reads: tables of grasps and a line of progress."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, StampedGrasp

HEADER = (
    f"{'#':>3}  {'epsilon':>8}  {'volume':>9}  {'isotropy':>8}  {'closed':>6}  {'contacts':>8}"
    f"  {'x, y, z [mm]':>22}  {'roll, pitch, yaw [deg]':>24}"
)

QUALITY_HEADER = f"  {'quality':>8}"
"""Of the column that stands beside them where another metric than epsilon was optimized."""
NOISE_HEADER = f"  {'expected':>8}  {'sd':>8}  {'worst':>8}"
"""Of the columns that stand beside them where quality under noise is known."""


def grasp_row(rank: int, grasp: Grasp) -> str:
    """Return one line of the table of grasps."""
    position = ", ".join(f"{1000 * value:.1f}" for value in grasp.T_object_tcp.position)
    angles = ", ".join(f"{value:.1f}" for value in np.degrees(grasp.T_object_tcp.rpy))
    return (
        f"{rank:>3}  {grasp.epsilon:>8.4f}  {grasp.volume:>9.2e}  {grasp.isotropy:>8.3f}"
        f"  {'yes' if grasp.force_closure else 'no':>6}  {len(grasp.contacts):>8}"
        f"  {position:>22}  {angles:>24}"
    )


def grasp_table(grasps: Sequence[StampedGrasp]) -> str:
    """Return a table of grasps, one a line, in the given order.

    The quality has a column of its own where it is not epsilon, figures under noise where any are known.
    """
    lines = [HEADER, *(grasp_row(rank, stamped.grasp) for rank, stamped in enumerate(grasps, start=1))]
    if any(stamped.grasp.quality != stamped.grasp.epsilon for stamped in grasps):
        cells = [QUALITY_HEADER, *(f"  {stamped.grasp.quality:>8.4g}" for stamped in grasps)]
        lines = list(map("".join, zip(lines, cells, strict=True)))
    if any(stamped.grasp.under_noise is not None for stamped in grasps):
        cells = [NOISE_HEADER, *(_under_noise_cells(stamped.grasp) for stamped in grasps)]
        lines = list(map("".join, zip(lines, cells, strict=True)))
    return "\n".join(lines)


def _under_noise_cells(grasp: Grasp) -> str:
    known = grasp.under_noise
    if known is None:
        return f"  {'-':>8}  {'-':>8}  {'-':>8}"
    return f"  {known.expected:>8.4f}  {known.sd:>8.4f}  {known.worst:>8.4f}"


def require_png(option: str, path: Path | None) -> None:
    """Refuse a picture of another kind before anything is computed; None is no picture.

    Raises:
        InvalidSettingsError: the file does not end in .png.
    """
    if path is not None and path.suffix.lower() != ".png":
        raise InvalidSettingsError(f"{option} {path} must end in .png")


class ProgressLine:
    """A live line on a terminal; on anything else a line each few seconds.

    Args:
        stream: where it is written; None for the standard error.
        period: seconds between two lines where the stream is no terminal.
    """

    BAR_WIDTH = 24

    def __init__(self, stream: TextIO | None = None, period: float = 5.0) -> None:
        self._stream = stream or sys.stderr
        self._live = self._stream.isatty()
        self._period = period
        self._due = 0.0
        self._complete = False

    def show(self, done: int, total: int, best: float, seconds_per_trial: float, note: str = "") -> None:
        """Write where things stand.

        Args:
            done: trials told.
            total: trials in all.
            best: best quality so far; NaN for none.
            seconds_per_trial: mean of late; 0 when unknown.
            note: what a person should know, empty for nothing.
        """
        now = time.monotonic()
        newly_complete = done >= total and not self._complete
        if not self._live and now < self._due and not newly_complete:
            return
        self._due = now + self._period
        self._complete = done >= total
        filled = self.BAR_WIDTH * done // max(total, 1)
        bar = "#" * filled + "-" * (self.BAR_WIDTH - filled)
        best_text = "-" if math.isnan(best) else f"{best:.4f}"
        rate = f"{1 / seconds_per_trial:.1f} trials/s" if seconds_per_trial > 0 else "- trials/s"
        left = f"{(total - done) * seconds_per_trial:.0f} s left" if seconds_per_trial > 0 else "- s left"
        line = f"[{bar}] {done}/{total} trials | best quality {best_text} | {rate} | {left}"
        self._write(f"{line} | {note}" if note else line)

    def _write(self, line: str) -> None:
        if self._live:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write("\r" + line[:width].ljust(width))
        else:
            self._stream.write(line + "\n")
        self._stream.flush()

    def end(self) -> None:
        """Leave the line as it is and go to the next."""
        if self._live:
            self._stream.write("\n")
            self._stream.flush()
