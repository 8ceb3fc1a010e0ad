"""Runs jobs in parallel processes or on a cluster, keeps every finished run, and continues after a stop or a kill.

Each job writes its own log as it goes (``run_job``). The parent alone appends finished runs to
``results.jsonl``, one line each, so a kill at any moment loses at most the line being written, which
the next start writes again from the run's complete log.

A run goes on as long as the folder's session is the one it was started in: the parent ends its session on
Ctrl-C, and a new parent begins one of its own, so that what a dead parent left running on a cluster stops.
"""

from __future__ import annotations

import json
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import traceback
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.locks import held
from mebo_grasp.experiments.runs.progress import Progress
from mebo_grasp.experiments.runs.results import Result, check_same_jobs, load_results, open_results
from mebo_grasp.experiments.runs.run_job import RunStopped, run_job

_LOCK_FILE, _SESSION_FILE = ".lock", ".session"
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

PoolFactory = Callable[[int], AbstractContextManager[tuple[Executor, int]]]
"""Opens what runs jobs, given how many there are; yields it and how many it runs side by side."""


@dataclass
class Outcome:
    """What came of a list of jobs.

    Args:
        results: finished runs, earlier ones included, in the order of the jobs.
        failures: (job's key, message) of the runs that ended in an error.
        interrupted: whether Ctrl-C ended it before all jobs were done.
    """

    results: list[Result] = field(default_factory=list)
    failures: list[tuple[str, str]] = field(default_factory=list)
    interrupted: bool = False


def _die_with_parent() -> None:
    """End this process as soon as its parent is gone, so that a killed benchmark leaves no writer behind."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _start_worker() -> None:
    threading.Thread(target=_die_with_parent, daemon=True).start()
    # Ctrl-C reaches the whole process group; the parent answers it and ends the session.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _work(job: Job, out: Path, session: str) -> Result:
    """Run one job in a worker; an error becomes a result of its own kind, so that one bad run ends alone."""
    try:
        return run_job(job, out, stop=lambda: _read_session(out) != session)
    except RunStopped:
        return {"kind": "stopped", "key": job.key}
    except MeboGraspError as error:
        return {"kind": "error", "key": job.key, "message": str(error)}
    except Exception:
        return {"kind": "error", "key": job.key, "message": traceback.format_exc()}


def _read_session(out: Path) -> str:
    try:
        return (out / _SESSION_FILE).read_text()
    except FileNotFoundError:
        return ""


def _sole_user(out: Path) -> AbstractContextManager[None]:
    """Hold the folder: two benchmarks that write the same logs would ruin both."""
    return held(out / _LOCK_FILE, f"{out} is in use by another process; wait for it or choose another --out")


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Child processes started inside use one BLAS thread; the variables are read when numpy is loaded."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


class _Session:
    """The right of runs to go on; ended by Ctrl-C."""

    def __init__(self, out: Path) -> None:
        self._path, self.name = out / _SESSION_FILE, uuid.uuid4().hex
        self._ended = threading.Event()
        self._path.write_text(self.name)

    @property
    def ended(self) -> bool:
        """Whether runs are to stop."""
        return self._ended.is_set()

    def end(self) -> None:
        """Let every run stop after the batch it is at."""
        self._ended.set()
        self._path.unlink(missing_ok=True)


@contextmanager
def _interrupt_ends(session: _Session) -> Iterator[None]:
    """The first Ctrl-C ends the session instead of breaking off what is being written; the next one kills."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def answer(number: int, frame: Any) -> None:
        del number, frame
        session.end()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def local_pool(workers: int) -> PoolFactory:
    """Return what opens processes of this machine, each with one BLAS thread.

    Args:
        workers: processes side by side.

    Raises:
        InvalidSettingsError: workers is below 1.
    """
    if workers < 1:
        raise InvalidSettingsError(f"workers must be at least 1, got {workers}")

    @contextmanager
    def open_pool(n_jobs: int) -> Iterator[tuple[Executor, int]]:
        context = multiprocessing.get_context("spawn")
        with _one_thread_each(), ProcessPoolExecutor(min(workers, n_jobs), context, _start_worker) as pool:
            yield pool, workers

    return open_pool


def run_jobs(
    jobs: Sequence[Job],
    out: Path,
    workers: int = 1,
    progress: TextIO | None = None,
    pool: PoolFactory | None = None,
) -> Outcome:
    """Run all jobs that are not finished yet.

    Ctrl-C (SIGINT) ends every run after the batch it is at; all that was evaluated is kept and the next
    call continues there.

    Args:
        jobs: what to run, in this order.
        out: the experiment's folder; made if absent. Workers of a cluster must see it under the same path.
        workers: processes side by side.
        progress: where the progress line goes; standard error if None.
        pool: opens what runs the jobs; processes of this machine if None.

    Raises:
        InvalidSettingsError: workers is below 1 or two jobs are the same.
        RunLogError: the folder is in use by another process, holds results of other settings, or cannot be read.
    """
    pool = pool or local_pool(workers)
    if len({job.key for job in jobs}) < len(jobs):
        raise InvalidSettingsError("two jobs are the same run; give each method, objective and seed once")
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    outcome = Outcome()
    with _sole_user(out):
        known = load_results(out)
        check_same_jobs(jobs, known, out)
        to_do = [job for job in jobs if job.key not in known]
        if to_do:
            with open_results(out) as stream, pool(len(to_do)) as (executor, side_by_side):
                bar = Progress(len(to_do), min(side_by_side, len(to_do)), progress or sys.stderr)
                bar.announce(to_do)
                _run_all(to_do, out, executor, stream, bar, known, outcome)
    outcome.results = [known[job.key] for job in jobs if job.key in known]
    return outcome


def _run_all(
    jobs: list[Job],
    out: Path,
    executor: Executor,
    stream: TextIO,
    bar: Progress,
    known: dict[str, Result],
    outcome: Outcome,
) -> None:
    session = _Session(out)
    try:
        with _interrupt_ends(session):
            futures = {executor.submit(_work, job, out, session.name): job for job in jobs}
            waiting = set(futures)
            while waiting:
                waiting = _collect(waiting, futures, stream, bar, known, outcome)
                if session.ended and not outcome.interrupted:
                    outcome.interrupted = True
                    waiting = {future for future in waiting if not future.cancel()}
            bar.show([], force=True)
            bar.close()
    finally:
        session.end()


def _answer(job: Job, future: Future[Result]) -> Result:
    """What came of a job, also if its worker died or could not load it."""
    try:
        return future.result()
    except Exception as error:
        return {"kind": "error", "key": job.key, "message": f"its worker failed: {error!r}"}


def _collect(
    waiting: set[Future[Result]],
    futures: dict[Future[Result], Job],
    stream: TextIO,
    bar: Progress,
    known: dict[str, Result],
    outcome: Outcome,
) -> set[Future[Result]]:
    """Wait a moment, keep what has finished, return what has not."""
    done, rest = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
    for future in done:
        job = futures[future]
        result = _answer(job, future)
        if result["kind"] == "error":
            outcome.failures.append((job.key, result["message"]))
        elif result["kind"] == "result":
            stream.write(json.dumps(result, allow_nan=False) + "\n")
            stream.flush()
            known[job.key] = result
        if result["kind"] != "stopped":
            bar.finished(job, result.get("wall_seconds"))
    bar.show([futures[future] for future in rest])
    return rest
