"""The thesis's tables from the results of a benchmark, beside the figures it prints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mebo_grasp.experiments import published
from mebo_grasp.experiments.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.metrics import STRICT_ACCURACIES, RunScore, Summary, summarize
from mebo_grasp.experiments.problems import (
    ALL_FUNCTIONS,
    AS_WRITTEN,
    BATCH_VARIANCE_FUNCTIONS,
    CLASSIC_FUNCTIONS,
    THESIS_FUNCTIONS,
)
from mebo_grasp.experiments.protocol import VARIANTS

Result = dict[str, Any]
_NONE = "-"
THESIS_ROW, SEEN_ROW = "*thesis {}*", "*best seen*"
ACQUISITION_ROWS = {"mebo_ei": "EI", "mebo_ucb": "UCB", "mebo": "EI-UCB"}
"""Rows of the acquisition study, tables 7.2 to 7.4, by our name of the method."""


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


@dataclass(frozen=True)
class ResultSet:
    """Results that can be picked by method and problem.

    Args:
        results: finished runs.
    """

    results: tuple[Result, ...]

    def pick(self, method: str, problem: str) -> list[Result]:
        """Runs of a method on a problem, as it is labelled."""
        return [r for r in self.results if r["job"]["method"] == method and _label(r) == problem]

    def methods(self, problems: Iterable[str]) -> list[str]:
        """Methods that have a run on one of the problems, in the order of their first run."""
        wanted = set(problems)
        return list(dict.fromkeys(r["job"]["method"] for r in self.results if _label(r) in wanted))

    def problems(self) -> list[str]:
        """Labels of the problems, in the order of their first run."""
        return list(dict.fromkeys(_label(r) for r in self.results))


def _label(result: Result) -> str:
    return f"{result['job']['problem']}~t" if result["job"]["transformed"] else str(result["job"]["problem"])


def summary_of(results: Sequence[Result]) -> Summary:
    """The thesis's metrics over runs, from their results.

    Raises:
        InvalidSettingsError: there is no run.
    """
    return summarize([
        RunScore(
            r["n_optima"],
            r["found"],
            np.array(r["found_values"]),
            r["first_all"],
            r["last_change"],
            np.array(r["curve"], dtype=np.int64),
        )
        for r in results
    ])  # fmt: skip


def _number(value: float, digits: int = 3) -> str:
    return _NONE if np.isnan(value) else f"{value:.{digits}f}"


def _spread(value: float, sd: float) -> str:
    return f"{_number(value)} ± {_number(sd, 2)}"


def _measured_cells(results: Sequence[Result]) -> list[str]:
    if not results:
        return [_NONE] * 5
    s = summary_of(results)
    return [
        _spread(s.peak_ratio, s.peak_ratio_sd),
        _number(s.success_rate, 2),
        _spread(s.speed_text, s.speed_text_sd),
        _number(s.speed_code),
        _number(s.mean_optimum, 4),
    ]


def _printed_cells(cells: Sequence[published.Cell], count: int) -> list[str]:
    flat: list[str] = []
    for i in range(count):
        if i < len(cells):
            pr, sr, cs, mean = cells[i]
            flat += [_number(pr), _number(sr, 2), _NONE, _number(cs), _number(mean, 4)]
        else:
            flat += [_NONE] * 5
    return flat


def _runs_text(results: ResultSet, method: str, problems: Iterable[str]) -> str:
    counts = sorted({len(results.pick(method, problem)) for problem in problems})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]}-{counts[-1]}"


_CS_NOTE = (
    "PR and CS: mean ± standard deviation over runs. CS: share of the budget when all optima had been found "
    "for the first time (the thesis's text); CS code: share at the last improvement of a found optimum "
    "(the thesis's code, the figure its tables print). Rows in italics are printed figures."
)


def comparison_table(
    printed: published.PublishedTable,
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
        header += [f"{published.TITLES[name]}: PR", "SR", "CS", "CS code", "MGOs"]
    body = []
    for method in present:
        cells = [cell for label in labels for cell in _measured_cells(results.pick(method, label))]
        body.append((rows[method], _runs_text(results, method, labels), *cells))
    for name, figures in printed.rows.items():
        body.append((THESIS_ROW.format(name), _NONE, *_printed_cells(figures, len(printed.functions))))
    seen = [cell for name in printed.functions for cell in _best_seen_cells(name)]
    body.append((SEEN_ROW, _NONE, *seen))
    title = f"Table {printed.number}" + (", functions shifted, scaled and turned at random" if suffix else "")
    return Table(title, tuple(header), tuple(body), _CS_NOTE)


def _best_seen_cells(name: str) -> list[str]:
    pr, sr, cs = published.BEST_SEEN[name]
    return [_number(pr), _number(sr, 2), _number(cs), _NONE, _NONE]


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
        header += [f"{published.TITLES[name]}: x", "y"]
    body = []
    for shown, method, suffix in rows:
        labels = [name + suffix for name in functions]
        cells = [cell for label in labels for cell in _variance_cells(results.pick(method, label))]
        if any(cell != _NONE for cell in cells):
            body.append((shown, _runs_text(results, method, labels), *cells))
    if not body:
        return None
    for name, values in printed.items():
        cells = [_number(v, 4) for function in functions for v in values[function]]
        body.append((THESIS_ROW.format(name), _NONE, *cells))
    own = (
        "Mean over batches of the population variance of a batch's points, ± standard deviation over runs; "
        "the initial design is left out."
    )
    return Table(title, tuple(header), tuple(body), f"{own} {note}".rstrip())


def _variance_cells(runs: Sequence[Result]) -> list[str]:
    """Mean and spread of the batch variance along x and y."""
    variances = np.array([r["batch_variance"] for r in runs if r["batch_variance"]])
    if len(variances) == 0:
        return [_NONE] * 2
    spread = np.std(variances, axis=0, ddof=1) if len(variances) > 1 else np.zeros(2)
    return [
        f"{_number(m, 4)} ± {_number(s, 2)}" for m, s in zip(np.mean(variances, axis=0), spread, strict=True)
    ]


def _mean_share(results: Sequence[Result], field: str, accuracy: float) -> str:
    if not results:
        return _NONE
    shares = np.array([r[field][f"{accuracy:g}"] / r["n_optima"] for r in results])
    return _spread(float(np.mean(shares)), float(np.std(shares, ddof=1)) if len(shares) > 1 else 0.0)


def strict_table(results: ResultSet, problems: Sequence[str]) -> Table | None:
    """PR of the returned solution sets at the strict accuracies, one optimum a basin."""
    methods = results.methods(problems)
    if not methods:
        return None
    header = ["method", "runs"]
    for label in problems:
        title = published.TITLES.get(label, label)
        header += [f"{title}: {a:g}" if i == 0 else f"{a:g}" for i, a in enumerate(STRICT_ACCURACIES)]
    body = []
    for method in methods:
        cells = [
            _mean_share(results.pick(method, label), "strict", accuracy)
            for label in problems
            for accuracy in STRICT_ACCURACIES
        ]
        body.append((method, _runs_text(results, method, problems), *cells))
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
    body = []
    for label in problems:
        cells = []
        for method in methods:
            runs = results.pick(method, label)
            cells += [_mean_share(runs, "basins", 0.1), _measured_cells(runs)[0]]
        budgets = sorted({r["job"]["budget"] for r in results.results if _label(r) == label})
        body.append((label, ", ".join(map(str, budgets)), *cells))
    note = (
        "PR 0.1: the competition's count over all evaluated points at accuracy 0.1, but never twice within "
        "one basin; PR 5 %: the thesis's rule (absolute 0.05 where the optimum is 0), which counts points farther "
        "apart than the niche radius as different and so over-counts on wide peaks where that radius is 0.01."
    )
    return Table("The other functions of the suite", tuple(header), tuple(body), note)


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
        tables += [
            comparison_table(table, runs, methods, suffix)
            for table in (published.METHODS_1D, published.METHODS_2D)
        ]
        tables.append(strict_table(runs, [label for label in labels if label in runs.problems()]))
    if set(STUDY_NAMES) & set(runs.methods(THESIS_FUNCTIONS)):
        tables += _acquisition_tables(runs)
    tables += _penalization_tables(runs)
    others = [
        p for p in runs.problems() if p.removesuffix("~t") in set(ALL_FUNCTIONS) - set(THESIS_FUNCTIONS)
    ]
    tables.append(suite_table(runs, others))
    tables.append(cost_table(runs))
    return [table for table in tables if table is not None]


def _acquisition_tables(runs: ResultSet) -> list[Table | None]:
    functions = ("himmelblau", "vincent_2d", "modified_rastrigin")
    return [
        comparison_table(published.ACQUISITION_1D, runs, ACQUISITION_ROWS),
        comparison_table(published.ACQUISITION_2D, runs, ACQUISITION_ROWS),
        batch_variance_table(
            "Table 7.4",
            published.BATCH_VARIANCE,
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
            published.BATCH_VARIANCE_PENALIZED,
            runs,
            readings,
            BATCH_VARIANCE_FUNCTIONS,
            _TWO_READINGS,
        ),
        comparison_table(published.LOCAL_PENALIZATION_1D, runs, rows),
        comparison_table(published.LOCAL_PENALIZATION_2D, runs, rows),
    ]
