"""A table and how numbers stand in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

NONE = "-"
"""Cell for what was not measured or not printed."""


@dataclass(frozen=True)
class Table:
    """A table to print.

    Args:
        title: one line above it.
        header: names of the columns.
        rows: cells as text, one tuple a row.
        note: one paragraph below it, or empty.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """The table as Markdown."""
        lines = [
            f"### {self.title}",
            "",
            _markdown_row(self.header),
            _markdown_row(["---"] * len(self.header)),
        ]
        lines += [_markdown_row(row) for row in self.rows]
        return "\n".join([*lines, *(["", self.note] if self.note else []), ""])

    def text(self) -> str:
        """The table in columns for a terminal."""
        widths = [max(len(row[i]) for row in (self.header, *self.rows)) for i in range(len(self.header))]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (self.header, *self.rows)
        ]
        return "\n".join([self.title, *lines, *([self.note] if self.note else []), ""])


def _markdown_row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def number(value: float, digits: int = 3) -> str:
    """A number with its digits behind the point; ``NONE`` for NaN."""
    return NONE if np.isnan(value) else f"{value:.{digits}f}"


def plus_minus(value: float, sd: float) -> str:
    """A mean with its standard deviation."""
    return f"{number(value)} ± {number(sd, 2)}"
