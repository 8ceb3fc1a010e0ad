"""Files of trials: which kinds there are and how each is read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from mebo_grasp.errors import InvalidFileError, InvalidSettingsError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.exchange import read_csv, read_jsonl

SUFFIXES = (".csv", ".jsonl", ".mcap")


def mcap_module() -> ModuleType:
    """Return the module for MCAP files; its libraries have no rosdep key, so they may be missing.

    Raises:
        InvalidFileError: they are.
    """
    try:
        from msg_adapters import mcap
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("mcap"):
            raise
        raise InvalidFileError(
            "MCAP files need two libraries that are not installed: pip install mcap mcap-ros2-support"
        ) from error
    return mcap


def suffix_of(file: Path) -> str:
    """Return the suffix that says what a file is.

    Raises:
        InvalidSettingsError: it is of no known kind.
    """
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InvalidSettingsError(f"'{file}' is of no known kind; use one of {', '.join(SUFFIXES)}")
    return suffix


def read_trials(file: Path, suffix: str, object_id: str, topic: str) -> Iterator[StampedGrasp]:
    """Read a file of trials, one at a time; object and topic tell them from others in an MCAP file."""
    if suffix == ".mcap":
        trials: Iterator[StampedGrasp] = mcap_module().read_mcap(file, object_id or None, topic)
        return trials
    return read_csv(file) if suffix == ".csv" else read_jsonl(file)
