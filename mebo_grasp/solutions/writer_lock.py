"""One writer a database: an advisory lock that the kernel takes back when its holder dies."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

from mebo_grasp.errors import ArchiveError


class WriterLock:
    """Holds ``<database>.lock`` until it is released or the process ends, by ``kill -9`` as well.

    The lock has a file of its own: closing any descriptor of the database itself would drop the locks
    that SQLite holds on it in this process.

    Args:
        database: file to guard.

    Raises:
        ArchiveError: another process, or another archive in this one, holds the lock; or the folder
            cannot be written.
    """

    def __init__(self, database: Path) -> None:
        self._path = database.with_name(database.name + ".lock")
        self._descriptor = self._acquire()
        # Only for the message to a second writer: on a full disk the lock holds without it.
        with contextlib.suppress(OSError):
            os.truncate(self._descriptor, 0)
            os.write(self._descriptor, f"{os.getpid()}\n".encode())

    def _acquire(self) -> int:
        while True:
            try:
                descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except OSError as error:
                raise ArchiveError(
                    f"cannot write beside the archive, in {self._path.parent}: {error.strerror}"
                ) from error
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                holder = os.read(descriptor, 32).decode(errors="replace").strip() or "unknown"
                os.close(descriptor)
                raise ArchiveError(
                    f"{self._path.with_suffix('')} is in use by process {holder}: an archive has one "
                    "writer; stop that process or name another file"
                ) from error
            except OSError as error:
                os.close(descriptor)
                raise ArchiveError(
                    f"cannot lock {self._path}: {error.strerror}; put the archive on a local disk"
                ) from error
            if self._is_current(descriptor):
                return descriptor
            os.close(descriptor)

    def _is_current(self, descriptor: int) -> bool:
        # The holder before may have removed the file between our open and our lock.
        try:
            return os.fstat(descriptor).st_ino == os.stat(self._path).st_ino
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Give the lock back and remove its file; harmless when called again."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):  # left behind in a folder that is read-only now, it locks nothing
                self._path.unlink()
            os.close(self._descriptor)
            self._descriptor = -1
