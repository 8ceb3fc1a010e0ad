"""The report of an experiment: one HTML page that needs no network, and tables, plots and pictures as files."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from mebo_grasp.experiments.definition import Definition
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.reports.cec2013_plots import plot_found_optima
from mebo_grasp.experiments.reports.grasp_sets import ShownSet, draw_sets, extreme_sets, viewer_data
from mebo_grasp.experiments.reports.study_plots import plot_best_values, plot_outcomes
from mebo_grasp.experiments.reports.study_tables import LEGEND, csv_text, make_tables, solution_table
from mebo_grasp.experiments.reports.table import Table
from mebo_grasp.experiments.scores.study_scores import Run
from mebo_grasp.solutions.page import page_template

PICTURED_METHODS = ("basin_search", "cl_mebo", "robot")
"""Whose worst and best sets are also drawn as pictures: the default and those that the thesis shows."""

_GROUP_PLOTS = {"best": ("best_values", plot_best_values), "outcome": ("outcomes", plot_outcomes)}
"""Plots of the objectives of a group by the metric that asks for them."""


@dataclass(frozen=True)
class Report:
    """What was written.

    Args:
        tables: in order.
        page: the HTML page.
        markdown, csv: the tables.
        pictures: plots and pictures.
    """

    tables: tuple[Table, ...]
    page: Path
    markdown: Path
    csv: Path
    pictures: tuple[Path, ...]


def write_report(definition: Definition, runs: Sequence[Run], out: Path, command: str) -> Report:
    """Write the report of the runs that are finished into a folder.

    Args:
        definition: the experiment.
        runs: at least one.
        out: the folder.
        command: that made it.
    """
    study = make_tables(definition.metrics, runs)
    tables = (*(item.table() for item in study), *_solution_tables(definition, runs))
    plots = _plots(definition, runs, out)
    sets = extreme_sets(runs) if "set" in definition.metrics else []
    drawn = draw_sets([item for item in sets if item.method in PICTURED_METHODS], out / "sets")
    facts = _facts(definition, runs, command)
    markdown, table_file, page = out / "tables.md", out / "tables.csv", out / "report.html"
    markdown.write_text(
        _markdown(definition, facts, tables, [*plots, *drawn], out),
        encoding="utf-8",
    )
    table_file.write_text(csv_text(study), encoding="utf-8")
    page.write_text(_page(definition, facts, tables, plots, sets), encoding="utf-8")
    return Report(tables, page, markdown, table_file, (*plots, *drawn))


def _solution_tables(definition: Definition, runs: Sequence[Run]) -> list[Table]:
    """Solutions as numbers, where they are no grasps to be looked at."""
    if "set" not in definition.metrics:
        return []
    objectives = dict.fromkeys(run.job.objective for run in runs)
    plain = [objective for objective in objectives if not isinstance(objective, GraspObjective)]
    found = [solution_table([run for run in runs if run.job.objective == objective]) for objective in plain]
    return [table for table in found if table is not None]


def _plots(definition: Definition, runs: Sequence[Run], out: Path) -> list[Path]:
    plots = []
    for metric, (stem, draw) in _GROUP_PLOTS.items():
        drawn = [run for run in runs if metric != "outcome" or run.trace.recommended]
        groups = dict.fromkeys(run.job.objective.group for run in drawn) if metric in definition.metrics else {}
        for group in groups:
            path = out / f"{stem}{'-' if group else ''}{re.sub('[^a-z0-9_]+', '-', group.lower())}.png"
            draw([run for run in drawn if run.job.objective.group == group], group, path)
            plots.append(path)
    with_optima = [run.result for run in runs if isinstance(run.job.objective, Cec2013)]
    if "optima" in definition.metrics and with_optima:
        path = out / "found_optima.png"
        plot_found_optima(with_optima, path)
        plots.append(path)
    return plots


def _facts(definition: Definition, runs: Sequence[Run], command: str) -> str:
    """What was run, as sentences."""
    missing = len(definition.jobs) - len(runs)
    seeds = sorted({run.job.seed for run in runs})
    cpu = sum(float(run.result["optimizer_cpu_seconds"]) for run in runs)
    versions: dict[str, set[str]] = {}
    for run in runs:
        for package, version in run.result["versions"].items():
            versions.setdefault(package, set()).add(version)
    facts = [
        f"{len(runs)} runs" + (f"; {missing} of {len(definition.jobs)} are not done" if missing else "") + ".",
        f"Seeds {', '.join(map(str, seeds))}.",
        f"The optimizers took {cpu:.0f} CPU seconds in all.",
        "Made with " + ", ".join(f"{name} {' and '.join(sorted(v))}" for name, v in versions.items()) + ".",
        f"Command: {command}",
    ]
    return " ".join(facts)


def _markdown(definition: Definition, facts: str, tables: Sequence[Table], pictures: Sequence[Path], out: Path) -> str:
    lines = [
        f"# {definition.title}",
        "",
        definition.about,
        "",
        facts,
        "",
        LEGEND,
        "",
    ]
    lines += [table.markdown() for table in tables]
    lines += [f"![{path.stem}]({path.relative_to(out)})\n" for path in pictures]
    return "\n".join(lines)


def _page(
    definition: Definition,
    facts: str,
    tables: Sequence[Table],
    plots: Sequence[Path],
    sets: Sequence[ShownSet],
) -> str:
    body = [
        f"<p>{html.escape(definition.about)}</p>",
        f"<p>{html.escape(facts)}</p>",
    ]
    body += ["<h2>Tables</h2>", f'<p class="note">{_inline(LEGEND)}</p>', *map(_table_html, tables)]
    body += ["<h2>Plots</h2>" if plots else "", *map(_image_html, plots)]
    if sets:
        body += [
            "<h2>Sets of grasps</h2>",
            "<p>The worst and the best set of each method, by M_d and then by mean quality; each grasp was executed "
            "once more for its contacts and final posture.</p>",
            '<p><select id="set"></select></p><iframe id="viewer" title="A set of grasps in 3-D"></iframe>',
        ]
    data = viewer_data(sets) if sets else {"sets": []}
    parts = {
        "TITLE": html.escape(definition.title),
        "BODY": "\n".join(body),
        "DATA": _json(data),
        "TEMPLATE": _json(page_template() if sets else ""),
    }
    page = files("mebo_grasp.experiments.reports").joinpath("report.html").read_text(encoding="utf-8")
    # In one pass, since the viewer's template has marks of its own.
    return re.sub("@(TITLE|BODY|DATA|TEMPLATE)@", lambda mark: parts[mark[1]], page)


def _json(value: Any) -> str:
    # "<" would end the script that holds it if a name contained "</script>".
    return json.dumps(value).replace("<", "\\u003c")


def _image_html(path: Path) -> str:
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<p><img alt="{html.escape(path.stem)}" src="data:image/png;base64,{encoded}"></p>'


def _table_html(table: Table) -> str:
    head = "".join(f"<th>{_inline(cell)}</th>" for cell in table.header)
    rows = []
    for row in table.rows:
        kind = ' class="printed"' if row[0].startswith("*") else ""
        rows.append(f"<tr{kind}>" + "".join(f"<td>{_inline(cell)}</td>" for cell in row) + "</tr>")
    return (
        f"<h3>{html.escape(table.title)}</h3>"
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
        f'<p class="note">{_inline(table.note)}</p>'
    )


def _inline(text: str) -> str:
    """Turn the two marks of a table's text, bold and italics, into HTML."""
    text = html.escape(text)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text)
    return re.sub(r"\*(.+?)\*", r"<i>\1</i>", text)
