"""The file of a run as JSON lines: created, locked, appended to, and read again after a kill.

Every line is flushed before the call returns, so a kill loses at most the last line, and a torn last line is dropped on
reading. What the lines say is the matter of whoever writes them (``logged_optimizer``, the experiments).
"""

from __future__ import annotations

import fcntl
import json
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TextIO

from mebo_grasp.errors import RunLogError

FORMAT_VERSION = 1
NOTE = "note"


def _package_version() -> str:
    try:
        return version("mebo_grasp")
    except PackageNotFoundError:
        return "unknown"


class RunLog:
    """An append-only file of JSON lines.

    Build it with ``RunLog.create`` (a new file) or ``RunLog.append`` (an existing one).
    """

    def __init__(self, path: Path, stream: TextIO) -> None:
        self.path = path
        self._stream = stream
        try:
            # The lock goes with the process, however it ends.
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            stream.close()
            raise RunLogError(
                f"the run log {path} is in use by another process: stop that one, or name another file"
            ) from error

    @classmethod
    def create(cls, path: str | os.PathLike[str], header: dict[str, Any]) -> RunLog:
        """Start a new log with its header.

        Raises:
            RunLogError: the file exists already or cannot be written.
        """
        target = Path(path)
        try:
            log = cls(target, target.open("x", encoding="utf-8"))
        except FileExistsError as error:
            raise RunLogError(f"{target} exists already; resume it or choose another file") from error
        except OSError as error:
            raise RunLogError(f"cannot create the run log {target}: {error}") from error
        log.write({"kind": "header", "format": FORMAT_VERSION, "version": _package_version(), **header})
        return log

    @classmethod
    def append(cls, path: str | os.PathLike[str]) -> RunLog:
        """Open an existing log to continue it; see ``reopen``."""
        return cls.reopen(path)[0]

    @classmethod
    def reopen(cls, path: str | os.PathLike[str]) -> tuple[RunLog, list[dict[str, Any]]]:
        """Open an existing log to continue it, and return its records; a torn last line is cut off.

        It is locked before it is read: a process that still writes might add what this one would not know.

        Raises:
            RunLogError: the file is absent, is not a run log (it is left as it is), or another process continues it.
        """
        target = Path(path)
        try:
            log = cls(target, target.open("r+", encoding="utf-8"))
        except OSError as error:
            raise RunLogError(f"cannot continue the run log {target}: {error}") from error
        try:
            lines = _complete_lines(_read(target))
            records = _records(lines, target)
            log._cut(sum(len(line) for line in lines))
        except BaseException:
            log.close()
            raise
        return log, records

    def _cut(self, size: int) -> None:
        try:
            self._stream.seek(size)
            self._stream.truncate()
        except OSError as error:
            raise RunLogError(f"cannot continue the run log {self.path}: {error}") from error

    @staticmethod
    def load(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
        """Read all complete records, the header first.

        Raises:
            RunLogError: the file is absent, has no header of a known format, or a line before the last is
                not a record.
        """
        target = Path(path)
        return _records(_complete_lines(_read(target)), target)

    def write(self, record: dict[str, Any]) -> None:
        """Append one record and hand it to the operating system.

        Raises:
            RunLogError: it holds what JSON cannot, or the disk refuses it.
        """
        try:
            self._stream.write(json.dumps(record, allow_nan=False) + "\n")
            self._stream.flush()
        except (OSError, TypeError, ValueError) as error:
            raise RunLogError(f"cannot write to the run log {self.path}: {error}") from error

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise RunLogError(f"cannot read the run log {path}: {error}") from error


def _complete_lines(content: bytes) -> list[bytes]:
    """Lines that end in a newline; if the last of them is no JSON, it was torn as well and goes."""
    lines = [line for line in content.splitlines(keepends=True) if line.endswith(b"\n")]
    if lines:
        try:
            json.loads(lines[-1])
        except ValueError:
            lines.pop()
    return lines


def _records(lines: list[bytes], path: Path) -> list[dict[str, Any]]:
    records = [_record(line, i, path) for i, line in enumerate(lines)]
    if not records or records[0].get("kind") != "header":
        raise RunLogError(
            f"{path} is not a run log: its first line is no header; name another file, or delete this one"
        )
    if records[0].get("format") != FORMAT_VERSION:
        raise RunLogError(f"{path} has format {records[0].get('format')!r}; this version reads {FORMAT_VERSION}")
    return records


def _record(line: bytes, index: int, path: Path) -> dict[str, Any]:
    try:
        record = json.loads(line)
    except ValueError as error:
        raise RunLogError(f"line {index + 1} of {path} is not JSON: {error}") from error
    if not isinstance(record, dict):
        raise RunLogError(f"line {index + 1} of {path} is not a record: {record!r}")
    return record
