"""A DDS domain of one's own, so that explorations and tests on one machine do not hear one another."""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
        path = Path(tempfile.gettempdir()) / f"mebo_grasp_domain_{domain_id}.lock"
        with path.open("a") as lock:
            try:
                # The lock goes with the process, however it ends.
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain_id
            return
    raise InvalidSettingsError(
        f"all DDS domain ids from {DOMAIN_IDS.start} to {DOMAIN_IDS.stop - 1} are in use: stop an exploration"
    )
