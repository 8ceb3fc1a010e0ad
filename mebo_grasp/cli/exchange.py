"""``mebo-grasp export`` and ``mebo-grasp import``: trials as CSV, JSON lines and MCAP files."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

from mebo_grasp.cli.filters import add_filter_arguments, metric_of, query_of
from mebo_grasp.cli.run_folder import DATABASE, StoredRun, add_run_arguments, read_run
from mebo_grasp.errors import InvalidFileError, InvalidSettingsError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.exchange import import_trials, read_csv, read_jsonl, write_csv, write_jsonl
from mebo_grasp.solutions.ranking import Ranking

SUFFIXES = (".csv", ".jsonl", ".mcap")


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add both commands to the command line."""
    export = commands.add_parser(
        "export",
        help="write the trials of a stored run as CSV, JSON lines or MCAP",
        description="Writes all trials, failed ones included; with any filter only the grasps that pass it, "
        "best first in the order of quality (MCAP: of time).",
    )
    add_run_arguments(export)
    export.add_argument("file", type=Path, help=f"file to write, its suffix says how: {', '.join(SUFFIXES)}")
    add_filter_arguments(export, max_grasps=None, min_diversity=0.0)
    export.set_defaults(run=run_export)
    import_ = commands.add_parser(
        "import",
        help="store the trials of a CSV, JSON lines or MCAP file",
        description="Stores what is not stored yet. A file with an error changes nothing.",
    )
    import_.add_argument("file", type=Path, help=f"file to read ({', '.join(SUFFIXES)})")
    import_.add_argument("run_folder", type=Path, help="folder of a run, or a database; made when absent")
    import_.add_argument("--object", help="name of the object (default: that of the run)")
    import_.add_argument("--topic", default="/grasp_quality", help="of an MCAP file (default: /grasp_quality)")
    import_.set_defaults(run=run_import)


def run_export(options: argparse.Namespace) -> int:
    """Write the file; returns the exit code."""
    suffix = _suffix(options.file)
    stored_run = StoredRun.of(options)
    metric = metric_of(options)
    is_filtered = bool(
        options.max_grasps is not None or options.min_quality or options.min_diversity or options.occlusion
        or options.rank_by != Ranking.OBSERVED.value
    )  # fmt: skip
    by_hand = bool(options.occlusion) and options.rule == BlockingRule.HAND.value
    with stored_run.open(by_hand, metric) as archive:
        trials: Iterable[StampedGrasp] = archive.grasps
        if is_filtered:
            if not by_hand:
                options.rule = BlockingRule.TCP.value  # nothing occludes: both rules are the same
            trials = archive.best(query_of(options, len(archive))).grasps
        if suffix == ".mcap":
            ordered = sorted(trials, key=lambda s: s.stamp_ns) if is_filtered else trials
            count = _mcap().write_mcap(ordered, options.file, stored_run.object_id)
        else:
            count = (write_csv if suffix == ".csv" else write_jsonl)(trials, options.file)
    print(f"{count} trials of '{stored_run.object_id}' written to {options.file}")
    return 0


def run_import(options: argparse.Namespace) -> int:
    """Store the trials; returns the exit code."""
    suffix = _suffix(options.file)
    folder: Path = options.run_folder
    path = folder if folder.suffix == ".db" else folder / DATABASE
    name = options.object or (read_run(path.parent).object if path.parent.is_dir() else "")
    first = next(_trials(options.file, suffix, name, options.topic), None)
    object_id = Path(name).stem or ("" if first is None else first.grasp.object_id)
    if not object_id:
        raise InvalidSettingsError(f"{options.file} does not name an object: name it by --object")
    path.parent.mkdir(parents=True, exist_ok=True)
    with SolutionArchive(path, object_id) as archive:
        read = partial(_trials, options.file, suffix, object_id, options.topic)
        new, stored = import_trials(archive, read), len(archive)
    print(f"{new} new trials of '{object_id}' stored in {path}, which holds {stored}")
    return 0


def _mcap() -> ModuleType:
    """Return the module for MCAP files; its libraries have no rosdep key, so they may be missing."""
    try:
        from msg_adapters import mcap
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("mcap"):
            raise
        raise InvalidFileError(
            "MCAP files need two libraries that are not installed: pip install mcap mcap-ros2-support"
        ) from error
    return mcap


def _suffix(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InvalidSettingsError(f"'{file}' is of no known kind; use one of {', '.join(SUFFIXES)}")
    return suffix


def _trials(file: Path, suffix: str, object_id: str, topic: str) -> Iterator[StampedGrasp]:
    if suffix == ".mcap":
        trials: Iterator[StampedGrasp] = _mcap().read_mcap(file, Path(object_id).stem or None, topic)
        return trials
    return read_csv(file) if suffix == ".csv" else read_jsonl(file)
