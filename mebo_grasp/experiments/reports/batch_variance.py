"""Tables of how far the points of a batch lie apart, in the form of the thesis's 7.4 and D.1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mebo_grasp.experiments.published import thesis
from mebo_grasp.experiments.reports.table import NONE, Table, number
from mebo_grasp.experiments.runs.results import Result
from mebo_grasp.experiments.scores.result_set import ResultSet


def batch_variance_table(
    title: str,
    printed: dict[str, dict[str, tuple[float, float]]],
    results: ResultSet,
    rows: Sequence[tuple[str, str, str]],
    functions: Sequence[str],
    note: str = "",
) -> Table | None:
    """A table in the form of 7.4 or D.1; None without a run for it.

    Args:
        title: of the table.
        printed: the thesis's rows.
        results: ours.
        rows: (name of the row, method, suffix of its problems).
        functions: the columns.
        note: what is to be said beside the table's own note.
    """
    header = ["method", "runs"]
    for name in functions:
        header += [f"{thesis.TITLES[name]}: x", "y"]
    body = []
    for shown, method, suffix in rows:
        labels = [name + suffix for name in functions]
        cells = [cell for label in labels for cell in _variance_cells(results.pick(method, label))]
        if any(cell != NONE for cell in cells):
            body.append((shown, results.runs_text(method, labels), *cells))
    if not body:
        return None
    for name, values in printed.items():
        cells = [number(v, 4) for function in functions for v in values[function]]
        body.append((thesis.THESIS_ROW.format(name), NONE, *cells))
    own = (
        "Mean over batches of the population variance of a batch's points, ± standard deviation over runs; "
        "the initial design is left out."
    )
    return Table(title, tuple(header), tuple(body), f"{own} {note}".rstrip())


def _variance_cells(runs: Sequence[Result]) -> list[str]:
    """Mean and spread of the batch variance along x and y."""
    variances = np.array([r["batch_variance"] for r in runs if r["batch_variance"]])
    if len(variances) == 0:
        return [NONE] * 2
    spread = np.std(variances, axis=0, ddof=1) if len(variances) > 1 else np.zeros(2)
    return [f"{number(m, 4)} ± {number(s, 2)}" for m, s in zip(np.mean(variances, axis=0), spread, strict=True)]
