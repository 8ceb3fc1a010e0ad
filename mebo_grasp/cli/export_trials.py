"""``mebo-grasp export``: the trials of a stored run as CSV, JSON lines or MCAP file."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from mebo_grasp.cli.filters import add_filter_arguments, metric_of, query_of
from mebo_grasp.cli.run_folder import StoredRun, add_run_arguments
from mebo_grasp.cli.trial_files import SUFFIXES, mcap_module, suffix_of
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.exchange import write_csv, write_jsonl
from mebo_grasp.solutions.ranking import Ranking


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Writes all trials, failed ones included; with any filter only the grasps that pass it, "
        "best first by the figure of --rank-by (MCAP: in the order of time)."
    )
    add_run_arguments(parser)
    parser.add_argument("file", type=Path, help=f"file to write, its suffix says how: {', '.join(SUFFIXES)}")
    add_filter_arguments(parser, max_grasps=None, min_diversity=0.0)


def run(options: argparse.Namespace) -> int:
    """Write the file; returns the exit code."""
    suffix = suffix_of(options.file)
    stored_run = StoredRun.of(options)
    metric = metric_of(options)
    is_filtered = bool(
        options.max_grasps is not None
        or options.min_quality
        or options.min_diversity
        or options.occlusion
        or options.rank_by != Ranking.OBSERVED.value
    )
    by_hand = bool(options.occlusion) and options.rule == BlockingRule.HAND.value
    with stored_run.open(by_hand, metric) as archive:
        trials: Iterable[StampedGrasp] = archive.grasps
        if is_filtered:
            if not by_hand:
                options.rule = BlockingRule.TCP.value  # nothing occludes: both rules are the same
            trials = archive.best(query_of(options, len(archive))).grasps
        if suffix == ".mcap":
            ordered = sorted(trials, key=lambda s: s.stamp_ns) if is_filtered else trials
            count = mcap_module().write_mcap(ordered, options.file, stored_run.object_id)
        else:
            count = (write_csv if suffix == ".csv" else write_jsonl)(trials, options.file)
    print(f"{count} trials of '{stored_run.object_id}' written to {options.file}")
    return 0
