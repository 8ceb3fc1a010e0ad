"""The tables of an experiment: a metric over methods and objectives, beside what the sources print.

Every cell is the mean ± standard deviation (n - 1) over runs and their number; the best of a column stands out, and
those that are significantly worse are marked. A single run has no deviation.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mebo_grasp.experiments.objective import Objective
from mebo_grasp.experiments.reports.printed_figures import Figures, printed_figures
from mebo_grasp.experiments.reports.table import NONE, Table
from mebo_grasp.experiments.runs.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.scores.statistics import LEVEL, against_best, mean_sd
from mebo_grasp.experiments.scores.study_scores import METRICS, Column, Run

WORSE = " †"
MOST_OBJECTIVE_COLUMNS = 6
"""With more objectives a table has a row for each of them, and their mean."""
LEGEND = (
    "Mean ± standard deviation (runs). **Bold**: best mean of a column; †: worse than it, p < "
    f"{LEVEL:g} (Wilcoxon signed-rank test, paired over seeds, Holm's correction over the methods; fewer than six "
    "seeds cannot show it). *Italics*: as printed, in the thesis over ten runs, in the UBO paper over 100 of a "
    "function and 30 of a grasp."
)
CSV_HEADER = (
    "table", "group", "objective", "column", "method", "source", "mean", "sd", "runs", "is_best", "p_against_best",
)  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """Runs of a method on an objective.

    Args:
        mean: over runs.
        sd: standard deviation over runs; 0 for a single one, which has none.
        runs: how many.
        is_best: whether its mean is the best of its column.
        p: adjusted p-value against the best; None for the best and where no value is better than another.
    """

    mean: float
    sd: float
    runs: int
    is_best: bool = False
    p: float | None = None

    def text(self, digits: int) -> str:
        """The cell as it is shown."""
        spread = f" ± {self.sd:.{digits}f}" if self.runs > 1 else ""
        text = f"{self.mean:.{digits}f}{spread} ({self.runs})"
        if self.is_best:
            return f"**{text}**"
        return text + (WORSE if self.p is not None and self.p < LEVEL else "")


@dataclass(frozen=True)
class TableColumn:
    """A column of a table: a number of the metric on an objective.

    Args:
        label: of the objective, for files.
        head: of the objective, for readers.
        column: the number.
        cells: by method.
        printed: what the source prints.
    """

    label: str
    head: str
    column: Column
    cells: dict[str, Cell]
    printed: Figures


@dataclass(frozen=True)
class StudyTable:
    """One metric on the objectives of one group.

    Args:
        metric: name of the metric.
        group: what the objectives have in common, or empty.
        methods: rows, in order.
        columns: in order.
    """

    metric: str
    group: str
    methods: tuple[str, ...]
    columns: tuple[TableColumn, ...]

    @property
    def title(self) -> str:
        """One line."""
        return METRICS[self.metric].title + (f": {self.group}" if self.group else "")

    def table(self) -> Table:
        """The table to print: a column for each objective, or a row where there are many of them."""
        note = METRICS[self.metric].note
        if len({item.label for item in self.columns}) > MOST_OBJECTIVE_COLUMNS:
            rows = [(self._head(item), *(self._text(item, m) for m in self.methods)) for item in self.columns]
            return Table(self.title, ("", *self.methods), tuple(rows), note)
        header = ["method"]
        for i, item in enumerate(self.columns):
            again = i > 0 and self.columns[i - 1].label == item.label
            header.append(item.column.name if again else self._head(item))
        rows = [(method, *(self._text(item, method) for item in self.columns)) for method in self.methods]
        printed = dict.fromkeys(name for item in self.columns for name in item.printed.rows)
        rows += [(name, *(_printed_text(item, name) for item in self.columns)) for name in printed]
        return Table(self.title, tuple(header), tuple(rows), note)

    def _head(self, item: TableColumn) -> str:
        # A metric of one number needs no name of the number.
        return item.head if len(METRICS[self.metric].columns) == 1 else f"{item.head}: {item.column.name}"

    @staticmethod
    def _text(item: TableColumn, method: str) -> str:
        cell = item.cells.get(method)
        return NONE if cell is None else cell.text(item.column.digits)

    def csv_rows(self) -> Iterable[tuple[str, ...]]:
        """One row a cell and printed figure, as ``CSV_HEADER`` has them."""
        for item in self.columns:
            begin = (self.metric, self.group, item.label, item.column.name)
            for method, cell in item.cells.items():
                p = "" if cell.p is None else f"{cell.p:.6g}"
                deviation = f"{cell.sd:.10g}" if cell.runs > 1 else ""
                numbers = (f"{cell.mean:.10g}", deviation, str(cell.runs), str(int(cell.is_best)), p)
                yield (*begin, method, "measured", *numbers)
            printed = item.printed
            for method, (mean, sd) in printed.by_method.items():
                spread = "" if sd is None else f"{sd:g}"
                yield (*begin, method, printed.source, f"{mean:g}", spread, str(printed.runs), "", "")


def _printed_text(item: TableColumn, name: str) -> str:
    if name not in item.printed.rows:
        return NONE
    mean, sd = item.printed.rows[name]
    digits = item.column.digits
    return f"{mean:.{digits}f}" + ("" if sd is None else f" ± {sd:.{digits}f}")


def make_tables(metrics: Sequence[str], runs: Sequence[Run]) -> list[StudyTable]:
    """Make the tables of an experiment, one a metric and group, in the order of the metrics.

    Args:
        metrics: names of ``METRICS``.
        runs: finished runs.
    """
    groups = dict.fromkeys(run.job.objective.group for run in runs)
    tables = [
        _make_table(metric, group, [run for run in runs if run.job.objective.group == group])
        for metric in metrics
        for group in groups
    ]
    return [table for table in tables if table.columns]


def _make_table(metric: str, group: str, runs: Sequence[Run]) -> StudyTable:
    values: dict[Objective, dict[str, dict[str, dict[int, float]]]] = {}
    for run in runs:
        for name, value in METRICS[metric].compute(run).items():
            if math.isfinite(value):
                cells = values.setdefault(run.job.objective, {}).setdefault(name, {})
                cells.setdefault(run.job.method, {})[run.job.seed] = value
    methods = tuple(dict.fromkeys(run.job.method for run in runs))
    is_study = bool(set(methods) & set(STUDY_NAMES))
    columns = METRICS[metric].columns
    made = [
        TableColumn(
            objective.label, objective.column, column, _cells(by_name[column.name], column),
            printed_figures(objective, column.name, is_study),
        )
        for objective, by_name in values.items()
        for column in columns
        if column.name in by_name
    ]  # fmt: skip
    if len(values) > MOST_OBJECTIVE_COLUMNS:
        made += [_over_all(list(values.values()), column) for column in columns]
    return StudyTable(metric, group, methods, tuple(made))


def _over_all(values: Sequence[dict[str, dict[str, dict[int, float]]]], column: Column) -> TableColumn:
    """The mean over all objectives, of the seeds at which a method has a value on each."""
    tables = [by_name.get(column.name, {}) for by_name in values]
    cells: dict[str, dict[int, float]] = {}
    for method in dict.fromkeys(method for by_method in tables for method in by_method):
        by_seed = [by_method.get(method, {}) for by_method in tables]
        whole = set.intersection(*(set(seeds) for seeds in by_seed))
        if whole:
            cells[method] = {seed: sum(v[seed] for v in by_seed) / len(by_seed) for seed in sorted(whole)}
    return TableColumn("all", f"mean over {len(values)}", column, _cells(cells, column), Figures())


def _cells(by_method: dict[str, dict[int, float]], column: Column) -> dict[str, Cell]:
    best, p_values = (None, {}) if column.higher_is_better is None else against_best(by_method, column.higher_is_better)
    cells = {}
    for method, by_seed in by_method.items():
        mean, sd = mean_sd(list(by_seed.values()))
        is_best = best is not None and mean == mean_sd(list(by_method[best].values()))[0]
        cells[method] = Cell(mean, sd, len(by_seed), is_best, p_values.get(method))
    return cells


def solution_table(runs: Sequence[Run]) -> Table | None:
    """The set that each method's best run returned on one objective; None without one.

    Args:
        runs: finished runs on one objective.
    """
    best: dict[str, Run] = {}
    for run in runs:
        values = run.solution_values
        if len(values) and run.trace.names:
            known = best.get(run.job.method)
            if known is None or max(values) > max(known.solution_values):
                best[run.job.method] = run
    if not best:
        return None
    rows = [
        (method, str(run.job.seed), f"{value:.4f}", *(f"{x:.4g}" for x in point))
        for method, run in best.items()
        for point, value in zip(run.trace.solutions, run.solution_values, strict=True)
    ]
    first = next(iter(best.values()))
    header = ("method", "seed", "value", *first.trace.names)
    note = "The set that a method returned in the run with its best value, best first."
    return Table(f"Solutions: {first.job.objective.column}", header, tuple(rows), note)


def csv_text(tables: Sequence[StudyTable]) -> str:
    """All tables as one CSV file in long form."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    for table in tables:
        writer.writerows(table.csv_rows())
    return stream.getvalue()
