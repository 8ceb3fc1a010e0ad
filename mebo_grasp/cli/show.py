"""``mebo-grasp show``: table, picture and 3-D page of a stored run."""

from __future__ import annotations

import argparse
from pathlib import Path

from mebo_grasp.cli.filters import add_filter_arguments, explain, metric_of, query_of
from mebo_grasp.cli.first_use import explained
from mebo_grasp.cli.report import grasp_table, require_png
from mebo_grasp.cli.run_folder import PAGE, PICTURE, StoredRun, add_run_arguments
from mebo_grasp.grasp_page import write_run_page
from mebo_grasp.grasping.rendering import render_grasps
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.solution_set import SolutionSet


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Prints the diverse grasps of a stored run and draws them: a picture, and a page with the grasps in 3-D that "
        "any browser opens without a network."
    )
    add_run_arguments(parser)
    add_filter_arguments(parser, max_grasps=4, min_diversity=0.04)
    parser.add_argument("--picture", type=Path, help="PNG file (default: beside the database)")
    parser.add_argument("--page", type=Path, help="HTML file with the grasps in 3-D (default: beside it)")


def run(options: argparse.Namespace) -> int:
    """Print the table, draw picture and page; returns the exit code."""
    require_png("--picture", options.picture)
    stored_run = StoredRun.of(options)
    target, hand = stored_run.target(), stored_run.hand()
    metric = metric_of(options)
    query = query_of(options, 1)
    with explained(), stored_run.open(query.rule is BlockingRule.HAND, metric) as archive:
        answer, stored = archive.best(query), len(archive)
    solutions = SolutionSet.of(target.object_id, answer.grasps, query.min_diversity, metric)
    print(
        f"{stored} trials of '{target.object_id}' in {stored_run.path}; {len(solutions.grasps)} grasps, "
        f"{solutions.diverse} diverse, mean quality {solutions.mean_quality:.4f}, mean distance to the "
        f"nearest {1000 * solutions.mean_min_distance:.0f} mm, QD {solutions.qd:.4f}"
    )
    if query.occlusions or answer.passed_over or not answer.grasps:
        print(explain(answer))
    if not solutions.grasps:
        return 0
    print(grasp_table(solutions.grasps))
    picture = options.picture or stored_run.path.with_name(PICTURE)
    render_grasps(target, hand, [stamped.grasp for stamped in solutions.grasps], picture)
    page = options.page or stored_run.path.with_name(PAGE)
    write_run_page(page, solutions, target, hand, query.occlusions)
    print(f"\npicture: {picture}\npage:    {page}")
    return 0
