"""``mebo-grasp show``: table and picture of a stored run."""

from __future__ import annotations

import argparse
from pathlib import Path

from mebo_grasp.cli.report import grasp_table
from mebo_grasp.cli.run_folder import DATABASE, PICTURE, read_run
from mebo_grasp.errors import ArchiveError
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.rendering import render_grasps
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.diversity import PoseMetric


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser("show", help="print and draw the diverse grasps of a stored run")
    parser.add_argument("run_folder", type=Path, help="folder of a run, or its database")
    parser.add_argument("--object", help="built-in name or mesh file (default: that of the run)")
    parser.add_argument("--scale", type=float, help="factor from the mesh's unit to metres")
    parser.add_argument("--hand", help="built-in name or hand description")
    parser.add_argument("--size", type=int, default=4, help="grasps in the solution set (default: 4)")
    parser.add_argument("--min-distance", type=float, default=0.04, help="least distance of two [m]")
    parser.add_argument("--picture", type=Path, help="PNG file (default: beside the database)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the table, draw the picture; returns the exit code."""
    path: Path = options.run_folder / DATABASE if options.run_folder.is_dir() else options.run_folder
    if not path.exists():
        raise ArchiveError(f"{path} does not exist; name the folder of a run, as given by explore --out")
    explored = read_run(path.parent)
    target = TargetObject.load(options.object or explored.object, options.scale or explored.scale)
    hand = HandModel.load(options.hand or explored.hand)
    with SolutionArchive(path, target.object_id, PoseMetric()) as archive:
        solutions = archive.solution_set(options.size, options.min_distance)
        stored = len(archive)
    print(f"{stored} trials of '{target.object_id}' in {path}; {len(solutions.grasps)} diverse grasps")
    if not solutions.grasps:
        print("no grasp with a quality above 0 is stored")
        return 0
    print(grasp_table(solutions.grasps))
    picture = options.picture or path.with_name(PICTURE)
    render_grasps(target, hand, [stamped.grasp for stamped in solutions.grasps], picture)
    print(f"\npicture: {picture}")
    return 0
