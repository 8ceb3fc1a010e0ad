"""Whether our versions of the thesis's methods do as well as the thesis prints, method by method."""

from __future__ import annotations

import numpy as np

from mebo_grasp.experiments.published import thesis
from mebo_grasp.experiments.reports.table import Table, number
from mebo_grasp.experiments.runs.job import BATCH_SIZE, BUDGET, N_INITIAL
from mebo_grasp.experiments.runs.results import Result
from mebo_grasp.experiments.scores.result_set import ResultSet


def thesis_standing_table(results: ResultSet) -> Table | None:
    """PR and SR of each method that the thesis measured, beside its figure; None without a run by its protocol."""
    rows = [
        row
        for method in thesis.PRINTED_NAMES
        for function, printed in thesis.thesis_figures(method).items()
        if (row := _row(method, function, printed, _by_protocol(results, method, function))) is not None
    ]
    if not rows:
        return None
    header = ("method", "function", "runs", "PR", "thesis's PR", "SR", "thesis's SR", "no worse")
    note = (
        "No worse: PR and SR at least the thesis's figure less one standard error of ours (± in the cells: standard "
        "deviation over runs by the root of their number)."
    )
    return Table("The thesis's methods against its own figures", header, tuple(rows), note)


def _by_protocol(results: ResultSet, method: str, function: str) -> list[Result]:
    """Runs of as many evaluations as the thesis made; with others its figures have nothing to say."""
    wanted = {"budget": BUDGET, "n_initial": N_INITIAL, "batch_size": BATCH_SIZE}
    return [run for run in results.pick(method, function) if wanted.items() <= run["job"].items()]


def _row(method: str, function: str, printed: thesis.Cell, runs: list[Result]) -> tuple[str, ...] | None:
    if not runs:
        return None
    ratios = np.array([run["found"] / run["n_optima"] for run in runs])
    cells, met = [], True
    for shares, figure in ((ratios, printed[0]), (ratios == 1.0, printed[1])):
        mean = float(np.mean(shares))
        error = float(np.std(shares, ddof=1) / np.sqrt(len(runs))) if len(runs) > 1 else 0.0
        cells += [f"{number(mean)} ± {number(error)}", number(figure)]
        # A hair of slack: printed figures are rounded to three digits.
        met = met and mean >= figure - error - 5e-4
    return (method, thesis.TITLES[function], str(len(runs)), *cells, "yes" if met else "NO")
