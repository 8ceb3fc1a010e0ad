"""Why a command is silent when it is used for the first time: numba compiles then."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

NOTICE = "preparing; a first use compiles, which takes a minute or two"


@contextmanager
def explained(seconds: float = 3.0) -> Iterator[None]:
    """Print a notice to the standard error if what is inside takes longer than so many seconds.

    The compiled code is cached, so later uses take no such time and are told nothing.
    """
    timer = threading.Timer(seconds, print, (NOTICE,), {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
