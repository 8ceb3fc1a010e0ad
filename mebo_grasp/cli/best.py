"""``mebo-grasp best``: the best grasps of a stored run that nothing blocks."""

from __future__ import annotations

import argparse
import json
import sys

from mebo_grasp.cli.filters import add_filter_arguments, explain, metric_of, query_of
from mebo_grasp.cli.first_use import explained
from mebo_grasp.cli.report import grasp_table
from mebo_grasp.cli.run_folder import StoredRun, add_run_arguments
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.exchange import to_record

EXIT_NONE_LEFT = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = "Answers as the service get_best_grasp does. Exit code 3 when no grasp is left."
    add_run_arguments(parser)
    add_filter_arguments(parser, max_grasps=1, min_diversity=0.0)
    parser.add_argument("--json", action="store_true", help="print one JSON object a grasp, nothing else")


def run(options: argparse.Namespace) -> int:
    """Print the grasps; returns the exit code."""
    stored_run = StoredRun.of(options)
    query = query_of(options, 1)
    with explained(), stored_run.open(query.rule is BlockingRule.HAND, metric_of(options)) as archive:
        answer = archive.best(query)
    if options.json:
        for stamped in answer.grasps:
            print(json.dumps(to_record(stamped)))
        if not answer.grasps:
            print(f"mebo-grasp best: {explain(answer)}", file=sys.stderr)
    else:
        if answer.grasps:
            print(grasp_table(answer.grasps))
        print(explain(answer))
    return 0 if answer.grasps else EXIT_NONE_LEFT
