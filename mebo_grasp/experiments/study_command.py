"""``mebo-grasp experiment NAME``: an experiment by its definition, from runs to report."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.definition import Definition, load_definition
from mebo_grasp.experiments.reports.report import write_report
from mebo_grasp.experiments.reports.study_tables import LEGEND
from mebo_grasp.experiments.runs.cluster import dask_pool
from mebo_grasp.experiments.runs.progress import say
from mebo_grasp.experiments.runs.results import load_results
from mebo_grasp.experiments.runs.runner import Outcome, local_pool, run_jobs
from mebo_grasp.experiments.scores.study_scores import Run

EXIT_FAILED, EXIT_INTERRUPTED = 1, 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Runs an experiment and writes its tables, plots and report. Every run is logged as it goes: the same command "
        "continues after a stop (Ctrl-C) or a kill; more methods or seeds extend what the folder holds."
    )
    parser.add_argument(
        "--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE", dest="overrides",
        help="set keys of the definition or settings of its objective, e.g. seeds=3 'methods=[default, robot]'",
    )  # fmt: skip
    parser.add_argument(
        "--only", nargs="+", action="extend", default=[], metavar="KEY=VALUE[,VALUE]", dest="conditions",
        help="leave out all runs but those with these settings, e.g. object=bottle space=position,pose",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="folder (default: out/NAME)")
    parser.add_argument("--workers", type=int, help="processes side by side (default: number of cores)")
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help="run on the Dask cluster of this scheduler (extra [cluster])"
    )
    parser.add_argument("--list", action="store_true", help="print the runs and what is done of them, run nothing")
    parser.add_argument("--report-only", action="store_true", help="make the report of what is there, run nothing")


def run(name: str, options: argparse.Namespace, command: str) -> int:
    """Run the command; returns the exit code.

    Args:
        name: of the experiment, or a file.
        options: as ``add_arguments`` has them.
        command: the whole command line, for the report.

    Raises:
        InvalidSettingsError: a key or value is wrong.
        InvalidFileError: there is no such experiment.
        RunLogError: the folder cannot be used.
    """
    definition = load_definition(name, _pairs(options.overrides)).only(_conditions(options.conditions))
    out = options.out or Path("out") / definition.name
    if options.list:
        return _list(definition, out)
    workers = options.workers if options.workers is not None else os.cpu_count() or 1
    if options.report_only:
        outcome = Outcome(_finished(definition, out))
    else:
        pool = dask_pool(options.cluster) if options.cluster else local_pool(workers)
        outcome = run_jobs(definition.jobs, out, workers, pool=pool)
    _report(definition, outcome, out, command)
    if outcome.interrupted:
        say(f"stopped; the same command continues in {out}", sys.stderr)
        return EXIT_INTERRUPTED
    for key, message in outcome.failures:
        say(f"failed: {key}: {message}", sys.stderr)
    return EXIT_FAILED if outcome.failures else 0


def _pairs(words: Sequence[str]) -> dict[str, Any]:
    found = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise InvalidSettingsError(f"{word!r} must be KEY=VALUE")
        try:
            found[key] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InvalidSettingsError(f"the value of {word!r} is not YAML: {error}") from error
    return found


def _conditions(words: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for word in words:
        key, equals, values = word.partition("=")
        if not equals:
            raise InvalidSettingsError(f"{word!r} must be KEY=VALUE or KEY=VALUE,VALUE")
        found[key] = values.split(",")
    return found


def _finished(definition: Definition, out: Path) -> list[dict[str, Any]]:
    known = load_results(out)
    return [known[job.key] for job in definition.jobs if job.key in known]


def _list(definition: Definition, out: Path) -> int:
    done = {result["key"] for result in _finished(definition, out)}
    for job in definition.jobs:
        say(f"{'done' if job.key in done else 'open':<5} {job.key}", sys.stdout)
    say(f"{len(done)} of {len(definition.jobs)} runs done in {out}", sys.stdout)
    return 0


def _report(definition: Definition, outcome: Outcome, out: Path, command: str) -> None:
    """Write the report of the finished runs and print its tables."""
    if not outcome.results:
        return
    say(f"making the report of {len(outcome.results)} runs", sys.stderr)
    jobs = {job.key: job for job in definition.jobs}
    runs = [Run.load(jobs[result["key"]], result, out) for result in outcome.results]
    report = write_report(definition, runs, out, command)
    for table in report.tables:
        say(table.text(), sys.stdout)
    say(f"{LEGEND}\n", sys.stdout)
    say(f"report: {report.page}; tables: {report.markdown}, {report.csv}", sys.stdout)
