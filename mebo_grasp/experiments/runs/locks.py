"""A file that one process holds at a time; the system lets go of it when the process ends."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mebo_grasp.errors import RunLogError


@contextmanager
def held(path: Path, message: str) -> Iterator[None]:
    """Hold a file, made if absent.

    Args:
        path: the file.
        message: of the error where another process holds it.

    Raises:
        RunLogError: another process holds it.
    """
    with path.open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RunLogError(message) from error
        yield
