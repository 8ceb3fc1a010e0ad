"""What may go wrong with a database file, in words that say what to do."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mebo_grasp.errors import ArchiveError

SQLITE_MAGIC = b"SQLite format 3\x00"


@contextmanager
def as_archive_errors(path: str, doing: str) -> Iterator[None]:
    """Turn what SQLite raises into an ``ArchiveError`` that names the file and a way out."""
    try:
        yield
    except sqlite3.Error as error:
        raise ArchiveError(f"cannot {doing} the archive {path}: {_explain(error)}") from error


def _explain(error: sqlite3.Error) -> str:
    text = str(error)
    if "readonly" in text or "unable to open" in text:
        return f"{text}; check the permissions of the file and of its folder"
    if "full" in text or "disk I/O error" in text:
        return f"{text}; free space on the disk, what is stored is untouched"
    if "malformed" in text or "not a database" in text:
        return f"{text}; the file is damaged: restore a copy or name another file"
    if "locked" in text:
        return f"{text}; another program writes to it"
    return text


def require_place(path: Path) -> None:
    """Refuse a place where no archive can be. The file is not opened: see ``require_database``.

    Raises:
        ArchiveError: the folder is missing, or there is a folder or a file that may not be written.
    """
    if not path.parent.is_dir():
        raise ArchiveError(f"the folder of the archive {path} does not exist; make it first")
    if path.is_dir():
        raise ArchiveError(f"the archive {path} is a folder; name a file")
    if path.exists() and not os.access(path, os.R_OK | os.W_OK):
        raise ArchiveError(f"the archive {path} cannot be opened for writing: Permission denied")


def require_database(path: Path) -> None:
    """Refuse what is not SQLite before SQLite gets a chance to touch it.

    To be called by the only writer: closing the file drops the locks that SQLite holds on it in this process.

    Raises:
        ArchiveError: the file exists and is no database, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            start = file.read(len(SQLITE_MAGIC))
    except FileNotFoundError:
        return
    except OSError as error:
        raise ArchiveError(f"the archive {path} cannot be read: {error.strerror}") from error
    if start and start != SQLITE_MAGIC:
        raise ArchiveError(f"{path} is not an SQLite database; it is left as it is, name another file")
