"""Keeps what a library prints while it is imported off the terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

STDERR = 2


@contextmanager
def quiet_stderr() -> Iterator[None]:
    """Send what C code writes to the standard error to nowhere; Python's exceptions pass.

    PyBullet tells its build time at import, in front of the output of every command and node.
    """
    try:
        saved = os.dup(STDERR)
    except OSError:  # it is closed: nothing can be seen anyway
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, STDERR)
    try:
        yield
    finally:
        os.dup2(saved, STDERR)
        os.close(saved)
        os.close(nowhere)
