"""Why a command is silent: numba compiles when it is used for the first time, or a mesh is prepared."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

NOTICE = "preparing; a large or concave mesh takes its time, and a first use compiles for a minute or two"


@contextmanager
def explained(seconds: float = 3.0) -> Iterator[None]:
    """Print a notice to the standard error if what is inside takes longer than so many seconds.

    The compiled code is cached, so that later uses with a mesh that is quickly prepared are told nothing.
    """
    timer = threading.Timer(seconds, print, (NOTICE,), {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
