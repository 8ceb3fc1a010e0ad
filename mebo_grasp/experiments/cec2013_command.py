"""``mebo-grasp experiment cec2013``: the multisolution benchmark from one command."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.problems import (
    CLASSIC_FUNCTIONS,
    THESIS_FUNCTIONS,
    get_problem,
    select_problems,
)
from mebo_grasp.experiments.reports.cec2013_plots import plot_found_optima
from mebo_grasp.experiments.reports.cec2013_tables import all_tables, legend
from mebo_grasp.experiments.runs.job import BATCH_SIZE, BUDGET, N_INITIAL, SEEDS, Job, make_jobs
from mebo_grasp.experiments.runs.peers import PEER_NAMES, installed_peers
from mebo_grasp.experiments.runs.progress import say
from mebo_grasp.experiments.runs.protocol import select_methods
from mebo_grasp.experiments.runs.run_costs import SECONDS, slow_peers
from mebo_grasp.experiments.runs.runner import Outcome, run_jobs
from mebo_grasp.experiments.scores.result_set import ResultSet

DEFAULT_METHODS = ("default", "mebo")
PENALIZATION = "local_penalization"
OTHER_BUDGET, OTHER_BUDGET_HIGH_DIM = 1000, 2000
"""Evaluations on the 14 functions beyond the thesis's, below and from 10 dimensions on."""
_BATCH_STUDY = {"budget": 150, "n_initial": 15}
"""Protocol of the thesis's table D.1."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Runs methods on the CEC 2013 niching functions and prints the thesis's tables beside its own "
        "figures. Every run is logged as it goes: the same command continues after a stop (Ctrl-C) or a "
        "kill, and more methods, functions or seeds extend what the folder holds."
    )
    parser.add_argument(
        "--methods", nargs="+", default=list(DEFAULT_METHODS), metavar="NAME",
        help="names, 'default', 'all' (every method of this package and the quick ones of the installed peers), "
        "'peers' (all that are installed), 'surrogates' (mebo with each) (default: default mebo)",
    )  # fmt: skip
    parser.add_argument(
        "--functions", nargs="+", default=["thesis"], metavar="NAME",
        help="names such as vincent, numbers 1 to 20, 'thesis' for its six, 'all' (default: thesis)",
    )  # fmt: skip
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"runs a cell (default: {SEEDS})")
    parser.add_argument(
        "--budget", type=int,
        help=f"evaluations a run (default: {BUDGET} for the thesis's functions, else {OTHER_BUDGET}, "
        f"from 10 dimensions on {OTHER_BUDGET_HIGH_DIM})",
    )  # fmt: skip
    parser.add_argument("--initial", type=int, default=N_INITIAL, help=f"initial design (default: {N_INITIAL})")
    parser.add_argument("--batch", type=int, default=BATCH_SIZE, help=f"points a batch (default: {BATCH_SIZE})")
    parser.add_argument(
        "--transform",
        action="store_true",
        help="shift, scale and turn each function at random, by the run's seed",
    )
    parser.add_argument("--out", type=Path, default=Path("out/cec2013"), help="folder (default: out/cec2013)")
    parser.add_argument("--workers", type=int, help="processes side by side (default: number of cores)")


def plan(args: argparse.Namespace) -> list[Job]:
    """The runs that the options ask for.

    Raises:
        InvalidSettingsError: a name is unknown or a number is out of range.
    """
    if args.seeds < 1:
        raise InvalidSettingsError(f"--seeds must be at least 1, got {args.seeds}")
    if args.batch < 1:
        raise InvalidSettingsError(f"--batch must be at least 1, got {args.batch}")
    methods = select_methods(args.methods, installed_peers())
    problems = [problem.name for problem in select_problems(args.functions)]
    protocol = {"n_initial": args.initial, "batch_size": args.batch}
    jobs: list[Job] = []
    for name in problems:
        objective = Cec2013(name, args.transform)
        jobs += make_jobs(methods, [objective], range(args.seeds), budget=_budget(args, name), **protocol)
    if PENALIZATION in methods and set(THESIS_FUNCTIONS) <= set(problems) and not args.transform:
        # Table D.1 belongs to the thesis's set, with functions and a protocol of its own.
        classics = [Cec2013(name) for name in CLASSIC_FUNCTIONS]
        jobs += make_jobs([PENALIZATION], classics, range(args.seeds), **_BATCH_STUDY)
    return sorted(jobs, key=lambda job: job.seed)


def _budget(args: argparse.Namespace, name: str) -> int:
    """Evaluations a run of a function."""
    budget = _usual_budget(name) if args.budget is None else int(args.budget)
    if budget < 1:
        raise InvalidSettingsError(f"--budget must be at least 1, got {budget}")
    if not 0 <= args.initial <= budget:
        raise InvalidSettingsError(
            f"--initial must lie between 0 and the budget {budget} of {name}, got {args.initial}"
        )
    return budget


def _usual_budget(name: str) -> int:
    if name in THESIS_FUNCTIONS:
        return BUDGET
    return OTHER_BUDGET_HIGH_DIM if get_problem(name).dim >= 10 else OTHER_BUDGET


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Returns:
        0 if all runs are done, 1 if one failed, 2 on bad options, 130 after Ctrl-C.
    """
    try:
        jobs = plan(args)
        say_left_out(args.methods, {job.method for job in jobs})
        workers = args.workers if args.workers is not None else os.cpu_count() or 1
        outcome = run_jobs(jobs, args.out, workers)
    except MeboGraspError as error:
        say(f"error: {error}", sys.stderr)
        return 2
    _report(outcome, jobs, args.out)
    if outcome.interrupted:
        say(f"stopped; the same command continues in {args.out}", sys.stderr)
        return 130
    for key, message in outcome.failures:
        say(f"failed: {key}: {message}", sys.stderr)
    return 1 if outcome.failures else 0


def say_left_out(asked: Sequence[str], chosen: set[str]) -> None:
    """Name the peers that a group of methods does without, and why."""
    if not {"all", "peers"} & set(asked):
        return
    installed = installed_peers()
    missing = [name for name in PEER_NAMES if name not in installed]
    slow = [name for name in slow_peers(installed) if name not in chosen]
    if missing:
        say(f"skipped, not installed (extra [peers]): {', '.join(missing)}", sys.stderr)
    if slow:
        costs = ", ".join(f"{name} (about {SECONDS[name]:.0f} s a run of {BUDGET})" for name in slow)
        say(f"left out of 'all' for their cost: {costs}; add 'peers' or their names to run them", sys.stderr)


def _report(outcome: Outcome, jobs: Sequence[Job], out: Path) -> None:
    """Print the tables and write them, with the plots, into the folder."""
    if not outcome.results:
        return
    tables = all_tables(outcome.results)
    for table in tables:
        say(table.text(), sys.stdout)
    missing = len(jobs) - len(outcome.results)
    head = [
        "# CEC 2013 niching benchmark",
        "",
        f"{len(outcome.results)} runs" + (f", {missing} of {len(jobs)} not done" if missing else "") + ".",
        "",
        legend(ResultSet(tuple(outcome.results))),
        "",
    ]
    text = "\n".join([*head, *(table.markdown() for table in tables)])
    (out / "tables.md").write_text(text, encoding="utf-8")
    plot_found_optima(outcome.results, out / "found_optima.png")
    say(f"tables and plots: {out / 'tables.md'}, {out / 'found_optima.png'}", sys.stdout)
