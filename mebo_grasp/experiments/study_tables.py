"""The tables of an experiment: a metric over methods and objectives, beside what the thesis prints.

Every cell is the mean ± standard deviation (n - 1) over runs and their number; the best of a column stands out, and
those that are significantly worse are marked.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mebo_grasp.experiments.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.objective import Objective
from mebo_grasp.experiments.published_grasps import Printed, printed_figures
from mebo_grasp.experiments.scores import METRICS, Column, Run
from mebo_grasp.experiments.statistics import LEVEL, against_best, mean_sd
from mebo_grasp.experiments.tables import THESIS_ROW, Table

NONE, WORSE = "-", " †"
LEGEND = (
    "Mean ± standard deviation (runs). **Bold**: best mean of a column; †: worse than it, p < "
    f"{LEVEL:g} (Wilcoxon signed-rank test, paired over seeds, Holm's correction over the methods; fewer than six "
    "seeds cannot show it). *Italics*: printed in the thesis, ten runs."
)
CSV_HEADER = (
    "table", "group", "objective", "column", "method", "source", "mean", "sd", "runs", "is_best", "p_against_best",
)  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """Runs of a method on an objective.

    Args:
        mean: over runs.
        sd: standard deviation over runs.
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
        text = f"{self.mean:.{digits}f} ± {self.sd:.{digits}f} ({self.runs})"
        if self.is_best:
            return f"**{text}**"
        return text + (WORSE if self.p is not None and self.p < LEVEL else "")


@dataclass(frozen=True)
class TableColumn:
    """A column of a table: a number of the metric on an objective.

    Args:
        objective: what was maximized.
        column: the number.
        cells: by method.
        printed: the thesis's figures by its names of methods.
    """

    objective: Objective
    column: Column
    cells: dict[str, Cell]
    printed: dict[str, Printed]


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
        """The table to print."""
        header = ["method"]
        for i, item in enumerate(self.columns):
            again = i > 0 and self.columns[i - 1].objective == item.objective
            head = item.objective.column
            # A metric of one number needs no second line of heads.
            single = len(METRICS[self.metric].columns) == 1
            header.append(head if single else item.column.name if again else f"{head}: {item.column.name}")
        rows = [(method, *(self._text(item, method) for item in self.columns)) for method in self.methods]
        printed = dict.fromkeys(name for item in self.columns for name in item.printed)
        rows += [
            (THESIS_ROW.format(name), *(_printed_text(item, name) for item in self.columns)) for name in printed
        ]
        return Table(self.title, tuple(header), tuple(rows), METRICS[self.metric].note)

    @staticmethod
    def _text(item: TableColumn, method: str) -> str:
        cell = item.cells.get(method)
        return NONE if cell is None else cell.text(item.column.digits)

    def csv_rows(self) -> Iterable[tuple[str, ...]]:
        """One row a cell and printed figure, as ``CSV_HEADER`` has them."""
        for item in self.columns:
            begin = (self.metric, self.group, item.objective.label, item.column.name)
            for method, cell in item.cells.items():
                p = "" if cell.p is None else f"{cell.p:.6g}"
                numbers = (f"{cell.mean:.10g}", f"{cell.sd:.10g}", str(cell.runs), str(int(cell.is_best)), p)
                yield (*begin, method, "measured", *numbers)
            for method, (mean, sd) in item.printed.items():
                yield (*begin, method, "thesis", f"{mean:g}", "" if sd is None else f"{sd:g}", "10", "", "")


def _printed_text(item: TableColumn, name: str) -> str:
    if name not in item.printed:
        return NONE
    mean, sd = item.printed[name]
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
    columns = [
        TableColumn(
            objective, column, _cells(by_name[column.name], column),
            printed_figures(objective, column.name, is_study),
        )
        for objective, by_name in values.items()
        for column in METRICS[metric].columns
        if column.name in by_name
    ]  # fmt: skip
    return StudyTable(metric, group, methods, tuple(columns))


def _cells(by_method: dict[str, dict[int, float]], column: Column) -> dict[str, Cell]:
    best, p_values = (
        (None, {}) if column.higher_is_better is None else against_best(by_method, column.higher_is_better)
    )
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
        if len(values) and run.names:
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
    header = ("method", "seed", "value", *first.names)
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
