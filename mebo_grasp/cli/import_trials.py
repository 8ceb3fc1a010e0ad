"""``mebo-grasp import``: stores the trials of a CSV, JSON lines or MCAP file."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from mebo_grasp.cli.run_folder import DATABASE, read_run
from mebo_grasp.cli.trial_files import SUFFIXES, read_trials, suffix_of
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.target_object import object_id_of
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.exchange import import_trials


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = "Stores what is not stored yet. A file with an error changes nothing."
    parser.add_argument("file", type=Path, help=f"file to read ({', '.join(SUFFIXES)})")
    parser.add_argument("run_folder", type=Path, help="folder of a run, or a database; made when absent")
    parser.add_argument("--object", help="name of the object (default: that of the run)")
    parser.add_argument("--topic", default="/grasp_quality", help="of an MCAP file (default: /grasp_quality)")


def run(options: argparse.Namespace) -> int:
    """Store the trials; returns the exit code."""
    suffix = suffix_of(options.file)
    folder: Path = options.run_folder
    path = folder if folder.suffix == ".db" else folder / DATABASE
    object_id = object_id_of(options.object or (read_run(path.parent).object if path.parent.is_dir() else ""))
    if not object_id:
        first = next(read_trials(options.file, suffix, "", options.topic), None)
        object_id = "" if first is None else first.grasp.object_id
    if not object_id:
        raise InvalidSettingsError(f"{options.file} does not name an object: name it by --object")
    path.parent.mkdir(parents=True, exist_ok=True)
    with SolutionArchive(path, object_id) as archive:
        read = partial(read_trials, options.file, suffix, object_id, options.topic)
        new, stored = import_trials(archive, read), len(archive)
    print(f"{new} new trials of '{object_id}' stored in {path}, which holds {stored}")
    return 0
