"""Jobs on a Dask cluster (extra ``[cluster]``): the same jobs, logs and results as with processes of one machine.

Workers run one job at a time each; they need this package, and must see the experiment's folder under the same path,
for every run writes its own log there.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.runs.runner import PoolFactory

CONNECT_SECONDS = 20


def dask_pool(address: str) -> PoolFactory:
    """Return what submits jobs to a Dask scheduler.

    Args:
        address: of the scheduler, e.g. ``tcp://10.0.0.2:8786``.

    Raises:
        InvalidSettingsError: Dask is not installed.
    """
    if find_spec("distributed") is None:
        raise InvalidSettingsError("a cluster needs the package distributed; pip install 'mebo_grasp[cluster]'")

    @contextmanager
    def open_pool(n_jobs: int) -> Iterator[tuple[Executor, int]]:
        del n_jobs
        # Imported here: it takes half a second, and no type is known where it is not installed.
        distributed: Any = import_module("distributed")
        try:
            client = distributed.Client(address, timeout=CONNECT_SECONDS)
        except (OSError, ValueError) as error:
            raise InvalidSettingsError(
                f"no Dask scheduler answers at {address!r} within {CONNECT_SECONDS} s ({error}); start one by "
                "`dask scheduler`, or leave --cluster out"
            ) from error
        with client, client.get_executor(pure=False, retries=0) as executor:
            yield executor, max(1, sum(client.nthreads().values()))

    return open_pool
