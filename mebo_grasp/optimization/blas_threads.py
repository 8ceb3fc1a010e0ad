"""Linear algebra on one thread, as long as an optimizer computes.

Its matrices have a few hundred rows. Threads of the linear algebra gain nothing on them; where other processes want the
same cores, each product waits for its slowest thread, and a run took five times as long. Sums are rounded alike
whatever the machine's number of cores, too, so that a seed gives the same trace.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    """The loaded libraries of linear algebra; finding them takes milliseconds, so it is done once."""
    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[object]:
    """Limit them to one thread, in the whole process, until the context is left.

    Of contexts that overlap in two threads the last one left restores what it found, which may be one thread.
    """
    limited: AbstractContextManager[object] = _libraries().limit(limits=1, user_api="blas")
    return limited
