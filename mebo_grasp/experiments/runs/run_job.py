"""One run: ask, evaluate, tell, with every step in a log; and what is told of it in the end.

A run that was killed continues from its log without evaluating a point again. Methods of this package
restore their state from the log; peers are asked again from the start with the same seed and get the
logged values (their own state is not ours to save).
"""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.experiments.objective import Evaluator, WantedSet
from mebo_grasp.experiments.runs.acquisition_study import STUDY_NAMES, StudyOptimizer
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.locks import held
from mebo_grasp.experiments.runs.peers import PEER_NAMES, Peer, make_peer, peer_packages
from mebo_grasp.experiments.runs.protocol import settings_of
from mebo_grasp.experiments.runs.recommendation import RecommendationJudge
from mebo_grasp.experiments.runs.run_trace import read_trace
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.optimizer import INITIAL_PHASE, Optimizer, Trial
from mebo_grasp.optimization.run_log import RunLog
from mebo_grasp.optimization.search_space import SearchSpace

StopCheck = Callable[[], bool]
RESULT_FORMAT = 1
"""Of a result's fields; results of another format are made again from the runs' logs."""
_PACKAGES = ("mebo_grasp", "numpy", "scipy", "scikit-learn", "numba")


class RunStopped(Exception):  # noqa: N818  it is a request, not an error
    """The run was asked to stop; its log holds what was done."""


def versions(method: str) -> dict[str, str]:
    """Versions of Python and of the packages that decide the run's trace."""
    found = {"python": platform.python_version()}
    for package in (*_PACKAGES, *peer_packages(method)):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def run_job(job: Job, out: Path, stop: StopCheck = lambda: False) -> dict[str, Any]:
    """Run or continue a job and return its result as JSON values.

    Args:
        job: what to run.
        out: the experiment's folder.
        stop: asked between batches; when it says yes, the run ends with ``RunStopped``.

    Raises:
        RunStopped: ``stop`` said yes.
        RunLogError: the run's log cannot be read, written or continued.
        InvalidSettingsError: the job names something unknown.
    """
    path = job.log_path(out)
    path.parent.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    run = _run_peer if job.method in (*PEER_NAMES, *STUDY_NAMES) else _run_method
    with _sole_writer(path), job.objective.open(job.seed) as evaluator:
        cpu_seconds, resumed, solutions = run(job, evaluator, path, stop)
        trace = replace(read_trace(path), solutions=solutions)
    return {
        "kind": "result",
        "format": RESULT_FORMAT,
        "key": job.key,
        "job": job.as_dict(),
        "versions": versions(job.method),
        "optimizer_cpu_seconds": cpu_seconds,
        "wall_seconds": time.perf_counter() - begin,
        "resumed": resumed,
        "solutions": solutions.tolist(),
        "evaluations": len(trace.y),
        "best_value": float(np.nanmax(trace.y)) if np.any(np.isfinite(trace.y)) else None,
        **job.objective.describe(trace, job.seed, job.budget),
    }


def _sole_writer(path: Path) -> AbstractContextManager[None]:
    """Hold a run's log: a worker that outlived its experiment may still be at the end of its last batch."""
    message = f"{path} is in use by another process; say the same command again later"
    return held(path.with_suffix(".lock"), message)


def _is_empty_log(path: Path) -> bool:
    """Whether a log was killed before its header was whole: nothing was evaluated, so it may go."""
    return path.exists() and b"\n" not in path.read_bytes()


class _CpuClock:
    """CPU time spent in ``with`` blocks, seconds."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._begin = 0.0

    def __enter__(self) -> None:
        self._begin = time.process_time()

    def __exit__(self, *_: object) -> None:
        self.seconds += time.process_time() - self._begin


def _run_method(job: Job, evaluator: Evaluator, path: Path, stop: StopCheck) -> tuple[float, bool, FloatArray]:
    if _is_empty_log(path):
        path.unlink()
    resumed, clock = path.exists(), _CpuClock()
    method, settings = settings_of(job)
    judged = read_trace(path).recommended if resumed else ()
    with clock:
        optimizer = (
            LoggedOptimizer.resume(path)
            if resumed
            else LoggedOptimizer.create(path, evaluator.space, method, settings, rng=job.seed)
        )
    try:
        if resumed:
            _check_same_run(optimizer.optimizer, settings, evaluator.space, path)
        judge = RecommendationJudge(evaluator, optimizer, judged)
        while not optimizer.finished:
            if stop():
                raise RunStopped
            with clock:
                trials = list(optimizer.pending) or optimizer.ask()
            values = evaluator(np.array([trial.x for trial in trials]))
            with clock:
                _tell(optimizer, trials, values)
            clock.seconds += judge.note()
        solutions = np.array([item.x for item in optimizer.solution_set()]).reshape(-1, evaluator.space.dim)
    finally:
        optimizer.close()
    return clock.seconds, resumed, solutions


def _tell(optimizer: LoggedOptimizer, trials: Sequence[Trial], values: FloatArray) -> None:
    """Tell the values of trials, shape (number of trials,); NaN is a failure."""
    for trial, value in zip(trials, values, strict=True):
        if math.isnan(value):
            optimizer.tell_failed(trial.id, "no value")
        else:
            optimizer.tell(trial.id, float(value))


def _check_same_run(optimizer: Optimizer, settings: MethodSettings, space: SearchSpace, path: Path) -> None:
    """Refuse to continue what another objective or other settings began."""
    same_space = all(
        np.array_equal(getattr(optimizer.space, what), getattr(space, what))
        for what in ("names", "lower", "upper", "distance_weights")
    )
    if not same_space or optimizer.settings != settings:
        raise RunLogError(
            f"{path} was begun with {'other settings' if same_space else 'another search space'}; choose another "
            "--out, or delete it to run it again"
        )


def _make_peer(job: Job, evaluator: Evaluator) -> Peer:
    space = evaluator.space
    if job.method in STUDY_NAMES:
        return StudyOptimizer(job.method, space, settings_of(job)[1], job.seed)
    return make_peer(job.method, space.lower, space.upper, job.n_initial, job.batch_size, job.seed)


def _run_peer(job: Job, evaluator: Evaluator, path: Path, stop: StopCheck) -> tuple[float, bool, FloatArray]:
    if _is_empty_log(path):
        path.unlink()
    resumed = path.exists()
    X, y = np.empty((0, evaluator.space.dim)), np.empty(0)
    if resumed:
        logged = read_trace(path)
        X, y = logged.X.reshape(-1, X.shape[1]), logged.y
    clock = _CpuClock()
    with clock:
        peer = _make_peer(job, evaluator)
    log = RunLog.append(path) if resumed else RunLog.create(path, _peer_header(job, evaluator.space))
    try:
        n = 0
        while n < job.budget:
            if stop():
                raise RunStopped
            with clock:
                batch = peer.ask(job.budget - n)
            phase = INITIAL_PHASE if n < job.n_initial else "peer"
            known = slice(n, n + len(batch))
            values = _answer_peer(evaluator, batch, (X[known], y[known]), n, phase, log)
            with clock:
                peer.tell(batch, values)
            n += len(batch)
            if len(y) < n:
                fresh = slice(len(y) - n, None)
                X, y = np.concatenate([X, batch[fresh]]), np.concatenate([y, values[fresh]])
    finally:
        log.close()
    return clock.seconds, resumed, _peer_solutions(job.objective.wanted_set(job.seed), evaluator.space, X, y)


def _peer_header(job: Job, space: SearchSpace) -> dict[str, Any]:
    return {
        "method": job.method,
        "seed": job.seed,
        "budget": job.budget,
        "versions": versions(job.method),
        "space": {"names": list(space.names), "distance_weights": space.distance_weights.tolist()},
    }


def _answer_peer(
    evaluator: Evaluator,
    batch: FloatArray,
    logged: tuple[FloatArray, FloatArray],
    first: int,
    phase: str,
    log: RunLog,
) -> FloatArray:
    """Values of a peer's batch: the logged ones as far as the log goes, evaluated and logged beyond."""
    logged_X, logged_y = logged
    known = len(logged_y)
    if known and not np.array_equal(batch[:known], logged_X):
        raise RunLogError(
            f"{log.path} cannot be continued: the peer asked other points than before at evaluation {first}; "
            "delete the file to run it again"
        )
    fresh = evaluator(batch[known:]) if known < len(batch) else np.empty(0)
    if np.any(np.isnan(fresh)):
        raise InvalidSettingsError(
            f"a trial between {first} and {first + len(batch) - 1} failed, and a peer cannot be told so; leave the "
            "peers out on this objective"
        )
    if known == 0:
        trials = [{"id": first + i, "x": x.tolist(), "phase": phase} for i, x in enumerate(batch)]
        log.write({"kind": "ask", "phase": phase, "trials": trials})
    for i, value in enumerate(fresh, start=known):
        log.write({"kind": "tell", "id": first + i, "value": float(value)})
    return np.concatenate([logged_y, fresh])


def _peer_solutions(wanted: WantedSet, space: SearchSpace, X: FloatArray, y: FloatArray) -> FloatArray:
    """Peers return no set of solutions; the best points that are far enough apart stand for it."""
    kept: list[int] = []
    for i in np.argsort(-y, kind="stable"):
        if len(kept) == wanted.size:
            break
        apart = np.linalg.norm((X[kept] - X[i]) * space.distance_weights, axis=1)
        if not kept or np.min(apart) > wanted.distance:
            kept.append(int(i))
    return X[kept]
