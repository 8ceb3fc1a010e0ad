"""The thesis's tables from the results of a benchmark, beside the figures it prints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mebo_grasp.experiments.problems import (
    ALL_FUNCTIONS,
    AS_WRITTEN,
    BATCH_VARIANCE_FUNCTIONS,
    CLASSIC_FUNCTIONS,
    THESIS_FUNCTIONS,
)
from mebo_grasp.experiments.problems.metrics import STRICT_ACCURACIES
from mebo_grasp.experiments.published import thesis
from mebo_grasp.experiments.reports.batch_variance import batch_variance_table
from mebo_grasp.experiments.reports.table import NONE, Table, number, plus_minus
from mebo_grasp.experiments.reports.thesis_standing import thesis_standing_table
from mebo_grasp.experiments.runs.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.runs.protocol import VARIANTS
from mebo_grasp.experiments.runs.results import Result
from mebo_grasp.experiments.scores.result_set import ResultSet, label_of, summary_of

SEEN_ROW = "*best seen*"
ACQUISITION_ROWS = {"mebo_ei": "EI", "mebo_ucb": "UCB", "mebo": "EI-UCB"}
"""Rows of the acquisition study, tables 7.2 to 7.4, by our name of the method."""


def _measured_cells(results: Sequence[Result]) -> list[str]:
    if not results:
        return [NONE] * 5
    s = summary_of(results)
    return [
        plus_minus(s.peak_ratio, s.peak_ratio_sd),
        number(s.success_rate, 2),
        plus_minus(s.speed_text, s.speed_text_sd),
        number(s.speed_code),
        number(s.mean_optimum, 4),
    ]


def _printed_cells(cells: Sequence[thesis.Cell], count: int) -> list[str]:
    flat: list[str] = []
    for i in range(count):
        if i < len(cells):
            pr, sr, cs, mean = cells[i]
            flat += [number(pr), number(sr, 2), NONE, number(cs), number(mean, 4)]
        else:
            flat += [NONE] * 5
    return flat


_CS_NOTE = (
    "PR and CS: mean ± standard deviation over runs. CS: share of the budget when all optima had been found "
    "for the first time (the thesis's text); CS code: share at the last improvement of a found optimum "
    "(the thesis's code, the figure its tables print). Rows in italics are printed figures."
)


def comparison_table(
    printed: thesis.PublishedTable,
    results: ResultSet,
    rows: dict[str, str],
    suffix: str = "",
) -> Table | None:
    """A table in the form of 7.2, 7.3, 7.6, 7.7, D.2 or D.3; None without a run for it.

    Args:
        printed: the thesis's table.
        results: ours.
        rows: our methods, each with its name in the table.
        suffix: ``~t`` for the transformed problems.
    """
    labels = [name + suffix for name in printed.functions]
    present = [method for method in rows if any(results.pick(method, label) for label in labels)]
    if not present:
        return None
    header = ["method", "runs"]
    for name in printed.functions:
        header += [f"{thesis.TITLES[name]}: PR", "SR", "CS", "CS code", "MGOs"]
    body = []
    for method in present:
        cells = [cell for label in labels for cell in _measured_cells(results.pick(method, label))]
        body.append((rows[method], results.runs_text(method, labels), *cells))
    for name, figures in printed.rows.items():
        body.append((thesis.THESIS_ROW.format(name), NONE, *_printed_cells(figures, len(printed.functions))))
    seen = [cell for name in printed.functions for cell in _best_seen_cells(name)]
    body.append((SEEN_ROW, NONE, *seen))
    title = f"Table {printed.number}" + (", functions shifted, scaled and turned at random" if suffix else "")
    return Table(title, tuple(header), tuple(body), _CS_NOTE)


def _best_seen_cells(name: str) -> list[str]:
    pr, sr, cs = thesis.BEST_SEEN[name]
    return [number(pr), number(sr, 2), number(cs), NONE, NONE]


def _mean_share(results: Sequence[Result], field: str, accuracy: float) -> str:
    if not results:
        return NONE
    shares = np.array([r[field][f"{accuracy:g}"] / r["n_optima"] for r in results])
    return plus_minus(float(np.mean(shares)), float(np.std(shares, ddof=1)) if len(shares) > 1 else 0.0)


def strict_table(results: ResultSet, problems: Sequence[str]) -> Table | None:
    """PR of the returned solution sets at the strict accuracies, one optimum a basin."""
    methods = results.methods(problems)
    if not methods:
        return None
    header = ["method", "runs"]
    for label in problems:
        title = thesis.TITLES.get(label, label)
        header += [f"{title}: {a:g}" if i == 0 else f"{a:g}" for i, a in enumerate(STRICT_ACCURACIES)]
    body = []
    for method in methods:
        cells = [
            _mean_share(results.pick(method, label), "strict", accuracy)
            for label in problems
            for accuracy in STRICT_ACCURACIES
        ]
        body.append((method, results.runs_text(method, problems), *cells))
    note = (
        "Peak ratio at absolute accuracies of the optimum's value, counted on the returned solution set with "
        "the competition's niche radius and never twice within one basin. A peer returns no set: the best "
        "point of each niche stands for it, as many as there are optima."
    )
    return Table("Returned solution sets at strict accuracies (PR)", tuple(header), tuple(body), note)


def suite_table(results: ResultSet, problems: Sequence[str]) -> Table | None:
    """The problems beyond the thesis's six: PR at accuracy 0.1 and by the thesis's rule."""
    methods = results.methods(problems)
    if not methods:
        return None
    header = ["function", "evaluations"] + [f"{m}: {what}" for m in methods for what in ("PR 0.1", "PR 5 %")]
    header.append("ahead by PR 0.1")
    body = []
    for label in problems:
        cells = []
        for method in methods:
            runs = results.pick(method, label)
            cells += [_mean_share(runs, "basins", 0.1), _measured_cells(runs)[0]]
        budgets = sorted({r["job"]["budget"] for r in results.results if label_of(r) == label})
        ahead = _ahead({method: results.pick(method, label) for method in methods})
        body.append((label, ", ".join(map(str, budgets)), *cells, ahead))
    note = (
        "PR 0.1: the competition's count over all evaluated points at accuracy 0.1, but never twice within "
        "one basin; PR 5 %: the thesis's rule (absolute 0.05 where the optimum is 0), which counts points farther "
        "apart than the niche radius as different and so over-counts on wide peaks where that radius is 0.01."
    )
    return Table("The other functions of the suite", tuple(header), tuple(body), note)


def _ahead(runs: dict[str, list[Result]]) -> str:
    """Methods whose mean peak ratio at accuracy 0.1 is the greatest; ``NONE`` where no method found an optimum."""
    ratios = {
        method: float(np.mean([r["basins"]["0.1"] / r["n_optima"] for r in own])) for method, own in runs.items() if own
    }
    best = max(ratios.values(), default=0.0)
    if best == 0.0:
        return NONE
    return ", ".join(method for method, ratio in ratios.items() if ratio >= best - 1e-9)


def cost_table(results: ResultSet) -> Table:
    """CPU seconds of the optimizer a run, without the function, and per point after the initial design."""
    body = []
    for method in results.methods(results.problems()):
        runs = [r for r in results.results if r["job"]["method"] == method and not r["resumed"]]
        seconds = np.array([r["optimizer_cpu_seconds"] for r in runs])
        points = np.array([r["job"]["budget"] - r["job"]["n_initial"] for r in runs])
        if len(runs) == 0:
            continue
        body.append((
            method, str(len(runs)),
            f"{np.mean(seconds):.2f}", f"{np.min(seconds):.2f}", f"{np.max(seconds):.2f}",
            f"{1000.0 * np.mean(seconds / np.maximum(points, 1)):.1f}",
        ))  # fmt: skip
    header = ("method", "runs", "mean [s]", "least [s]", "most [s]", "ms a point")
    note = "CPU time in the optimizer, one core a run; runs that were resumed are left out."
    return Table("Cost", header, tuple(body), note)


def legend(results: ResultSet) -> str:
    """What each variant among the methods differs in, as Markdown lines; empty without a variant."""
    used = [m for m in results.methods(results.problems()) if m in VARIANTS]
    return "\n".join(f"- `{name}`: `{VARIANTS[name].method}`, {VARIANTS[name].note}." for name in used)


def all_tables(results: Sequence[Result]) -> list[Table]:
    """Every table for which there is a run, in the order of the thesis."""
    runs = ResultSet(tuple(results))
    tables: list[Table | None] = []
    for suffix in ("", "~t"):
        labels = [name + suffix for name in THESIS_FUNCTIONS]
        methods = {m: m for m in runs.methods(labels) if m not in STUDY_NAMES}
        tables += [comparison_table(table, runs, methods, suffix) for table in (thesis.METHODS_1D, thesis.METHODS_2D)]
        tables.append(strict_table(runs, [label for label in labels if label in runs.problems()]))
    if set(STUDY_NAMES) & set(runs.methods(THESIS_FUNCTIONS)):
        tables += _acquisition_tables(runs)
    tables += _penalization_tables(runs)
    others = [p for p in runs.problems() if p.removesuffix("~t") in set(ALL_FUNCTIONS) - set(THESIS_FUNCTIONS)]
    tables.append(thesis_standing_table(runs))
    tables.append(suite_table(runs, others))
    tables.append(cost_table(runs))
    return [table for table in tables if table is not None]


def _acquisition_tables(runs: ResultSet) -> list[Table | None]:
    functions = ("himmelblau", "vincent_2d", "modified_rastrigin")
    return [
        comparison_table(thesis.ACQUISITION_1D, runs, ACQUISITION_ROWS),
        comparison_table(thesis.ACQUISITION_2D, runs, ACQUISITION_ROWS),
        batch_variance_table(
            "Table 7.4",
            thesis.BATCH_VARIANCE,
            runs,
            [(shown, method, "") for method, shown in ACQUISITION_ROWS.items()],
            functions,
        ),
    ]


_TWO_READINGS = (
    "The thesis states neither the boxes nor the sign with which the functions were run. Negated, the published "
    "minima are sought; as written, the greatest values, which lie at corners of the box."
)


def _penalization_tables(runs: ResultSet) -> list[Table | None]:
    rows = {"local_penalization": "local_penalization"}
    readings = [
        (f"{method}, {sign}", method, suffix)
        for method in runs.methods(CLASSIC_FUNCTIONS)
        for sign, suffix in (("functions negated", ""), ("functions as written", AS_WRITTEN))
    ]
    return [
        batch_variance_table(
            "Table D.1",
            thesis.BATCH_VARIANCE_PENALIZED,
            runs,
            readings,
            BATCH_VARIANCE_FUNCTIONS,
            _TWO_READINGS,
        ),
        comparison_table(thesis.LOCAL_PENALIZATION_1D, runs, rows),
        comparison_table(thesis.LOCAL_PENALIZATION_2D, runs, rows),
    ]
