"""A DDS domain of one's own, so that explorations and tests on one machine do not hear one another."""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from mebo_grasp.errors import InvalidSettingsError

DOMAIN_IDS = range(1, 102)
"""Domain ids whose ports lie below Linux's range of ephemeral ports (ROS 2 documentation, domain id)."""


@contextmanager
def private_domain() -> Iterator[int]:
    """Reserve a domain id that no other process on this machine has reserved this way.

    Raises:
        InvalidSettingsError: all ids are taken.
    """
    for domain_id in DOMAIN_IDS:
        lock = _locked_file(domain_id)
        if lock is not None:
            with lock:
                yield domain_id
            return
    raise InvalidSettingsError(
        f"all DDS domain ids from {DOMAIN_IDS.start} to {DOMAIN_IDS.stop - 1} are in use: stop an exploration, or "
        f"look at the files mebo_grasp_domain_*.lock in {tempfile.gettempdir()}"
    )


def _locked_file(domain_id: int) -> IO[str] | None:
    """Return the locked file that stands for a domain id; None where somebody else holds or hides it."""
    path = Path(tempfile.gettempdir()) / f"mebo_grasp_domain_{domain_id}.lock"
    try:
        # What another user made in a folder for all may be read only, and to read is enough for a lock.
        lock = path.open("r" if path.exists() else "a")
    except OSError:
        return None
    try:
        # The lock goes with the process, however it ends.
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        return None
    return lock
