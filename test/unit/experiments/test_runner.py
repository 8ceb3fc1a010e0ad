"""Runs in parallel, their logs and results, and what a kill, a stop or an error does to them."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.experiments.objectives import cec2013 as cec2013_objective
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.problems import Problem, get_problem
from mebo_grasp.experiments.runs import peers
from mebo_grasp.experiments.runs import run_job as run_job_module
from mebo_grasp.experiments.runs.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.runs.job import Job, make_jobs
from mebo_grasp.experiments.runs.results import RESULTS_FILE, load_results
from mebo_grasp.experiments.runs.run_job import RunStopped, run_job
from mebo_grasp.experiments.runs.run_trace import read_trace
from mebo_grasp.experiments.runs.runner import _sole_user, _work, run_jobs
from mebo_grasp.grasp import FloatArray

SMALL: dict[str, Any] = {"budget": 16, "n_initial": 7, "batch_size": 3}
HIMMELBLAU = Cec2013("himmelblau")
MEBO = Job("mebo", HIMMELBLAU, 3, **SMALL)
REPOSITORY = Path(__file__).resolve().parents[3]


class CountedEvaluations:
    """Counts how often each point is really evaluated, through the problem that the run builds."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.points: list[tuple[float, ...]] = []
        original = Cec2013.make

        def counted(objective: Cec2013, seed: int) -> Problem:
            problem = original(objective, seed)
            function = problem.function

            def evaluate(X: FloatArray) -> FloatArray:
                self.points += [tuple(x) for x in X]
                return function(X)

            object.__setattr__(problem, "function", evaluate)
            return problem

        monkeypatch.setattr(Cec2013, "make", counted)
        # Scoring evaluates as well; only the run's own evaluations are counted here.
        monkeypatch.setattr(cec2013_objective, "strict_count", lambda *_: 0)


class GoldenPeer:
    """A real, deterministic optimizer in one class: a Kronecker sequence in pairs."""

    def __init__(self, task: peers.PeerTask) -> None:
        self._task, self._n = task, 0

    def ask(self, left: int) -> FloatArray:
        """The next two points."""
        k = np.arange(self._n + 1, self._n + 1 + min(2, left))[:, None]
        return self._task.to_box((k * np.array([0.7548776662, 0.5698402910])[: self._task.dim]) % 1.0)

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Count."""
        del points
        self._n += len(values)


@pytest.fixture
def golden_peer(monkeypatch: pytest.MonkeyPatch) -> str:
    kind = peers._PeerKind((), (), GoldenPeer)
    monkeypatch.setitem(peers._PEERS, "golden", kind)
    monkeypatch.setattr(run_job_module, "PEER_NAMES", (*peers.PEER_NAMES, "golden"))
    return "golden"


def _trace(job: Job, out: Path) -> tuple[FloatArray, FloatArray]:
    trace = read_trace(job.log_path(out))
    return trace.X, trace.y


def _trace_of(job: Job, out: Path) -> FloatArray:
    run_job(job, out)
    return _trace(job, out)[0]


def test_a_run_uses_its_budget_and_its_log_holds_the_trace(tmp_path: Path) -> None:
    result = run_job(MEBO, tmp_path)
    trace = read_trace(MEBO.log_path(tmp_path))
    X, y, batches = trace.X, trace.y, trace.batches
    assert result["evaluations"] == len(X) == len(y) == 16
    problem = HIMMELBLAU.make(MEBO.seed)
    np.testing.assert_array_equal(y, problem(X))
    assert batches == [[7, 8, 9], [10, 11, 12], [13, 14, 15]]
    expected = np.mean([np.var(X[batch], axis=0) for batch in batches], axis=0)
    np.testing.assert_allclose(result["batch_variance"], expected)
    assert result["optimizer_cpu_seconds"] > 0.0
    assert {"python", "numpy", "scipy", "mebo_grasp"} <= set(result["versions"])
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize("kept_share", [0.0, 0.001, 0.2, 0.5, 0.77, 1.0])
def test_a_cut_log_continues_to_the_same_trace_without_evaluating_a_point_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept_share: float
) -> None:
    whole = run_job(MEBO, tmp_path / "whole")
    content = MEBO.log_path(tmp_path / "whole").read_bytes()
    cut = MEBO.log_path(tmp_path / "cut")
    cut.parent.mkdir(parents=True)
    cut.write_bytes(content[: round(kept_share * len(content))])
    told = cut.read_bytes().count(b'"tell"')
    counted = CountedEvaluations(monkeypatch)
    again = run_job(MEBO, tmp_path / "cut")
    for first, second in zip(_trace(MEBO, tmp_path / "whole"), _trace(MEBO, tmp_path / "cut"), strict=True):
        np.testing.assert_array_equal(first, second)
    assert again["found"] == whole["found"]
    assert again["solutions"] == whole["solutions"]
    # A torn last line may hold one more value that was not whole and so is evaluated again.
    assert 16 - told <= len(counted.points) <= 16 - told + 1
    assert len(set(counted.points)) == len(counted.points)


@pytest.mark.parametrize("from_the_end", [1, 2, 3, 4, 5, 8])
def test_open_trials_of_a_cut_log_are_evaluated_before_new_ones_are_asked(tmp_path: Path, from_the_end: int) -> None:
    # The last lines are ask, tell, tell, tell: each cut leaves another number of open trials.
    run_job(MEBO, tmp_path)
    before = _trace(MEBO, tmp_path)
    path = MEBO.log_path(tmp_path)
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-from_the_end]))
    assert run_job(MEBO, tmp_path)["evaluations"] == 16
    for first, second in zip(before, _trace(MEBO, tmp_path), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", STUDY_NAMES)
def test_the_acquisition_study_runs_and_continues_after_a_cut(tmp_path: Path, name: str) -> None:
    job = Job(name, HIMMELBLAU, 1, **SMALL)
    whole = run_job(job, tmp_path)
    before = _trace(job, tmp_path)
    batches = read_trace(job.log_path(tmp_path)).batches
    assert batches == [[7, 8, 9], [10, 11, 12], [13, 14, 15]]
    path = job.log_path(tmp_path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run_job(job, tmp_path)["found_values"] == whole["found_values"]
    for first, second in zip(before, _trace(job, tmp_path), strict=True):
        np.testing.assert_array_equal(first, second)


def test_the_acquisition_study_differs_by_its_acquisition_alone(tmp_path: Path) -> None:
    traces = [_trace_of(Job(name, HIMMELBLAU, 1, **SMALL), tmp_path) for name in (*STUDY_NAMES, "mebo")]
    for trace in traces[1:]:
        np.testing.assert_array_equal(trace[:7], traces[0][:7])
        assert not np.array_equal(trace[7:], traces[0][7:])


@pytest.mark.parametrize("kept_share", [0.0, 0.4, 0.8])
def test_a_peers_cut_log_continues_the_same_way(
    tmp_path: Path, golden_peer: str, monkeypatch: pytest.MonkeyPatch, kept_share: float
) -> None:
    job = Job(golden_peer, HIMMELBLAU, 0, **SMALL)
    run_job(job, tmp_path / "whole")
    content = job.log_path(tmp_path / "whole").read_bytes()
    cut = job.log_path(tmp_path / "cut")
    cut.parent.mkdir(parents=True)
    cut.write_bytes(content[: round(kept_share * len(content))])
    told = cut.read_bytes().count(b'"tell"')
    counted = CountedEvaluations(monkeypatch)
    result = run_job(job, tmp_path / "cut")
    for first, second in zip(_trace(job, tmp_path / "whole"), _trace(job, tmp_path / "cut"), strict=True):
        np.testing.assert_array_equal(first, second)
    assert result["evaluations"] == 16
    assert 16 - told <= len(counted.points) <= 16 - told + 1


def test_a_batch_that_a_killed_peer_noted_twice_is_one(tmp_path: Path, golden_peer: str) -> None:
    job = Job(golden_peer, HIMMELBLAU, 0, **SMALL)
    whole = run_job(job, tmp_path)
    path = job.log_path(tmp_path)
    lines = path.read_bytes().splitlines(keepends=True)
    last_ask = max(i for i, line in enumerate(lines) if b'"ask"' in line)
    path.write_bytes(b"".join(lines[: last_ask + 1]))
    assert run_job(job, tmp_path)["batch_variance"] == whole["batch_variance"]
    assert read_trace(path).batches == [[8, 9], [10, 11], [12, 13], [14, 15]]


@pytest.mark.parametrize("method", ["mebo", "golden"])
def test_a_log_of_a_header_alone_continues(tmp_path: Path, golden_peer: str, method: str) -> None:
    del golden_peer
    job = Job(method, HIMMELBLAU, 0, **SMALL)
    whole = run_job(job, tmp_path)
    path = job.log_path(tmp_path)
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    emptied = read_trace(path)
    assert (emptied.X.shape, emptied.y.shape, emptied.batches) == ((0, 2), (0,), [])
    assert run_job(job, tmp_path)["found_values"] == whole["found_values"]


def test_a_peer_that_asks_other_points_than_before_is_not_continued(tmp_path: Path, golden_peer: str) -> None:
    job = Job(golden_peer, HIMMELBLAU, 0, **SMALL)
    run_job(job, tmp_path)
    path = job.log_path(tmp_path)
    lines = path.read_text().splitlines(keepends=True)
    altered = json.loads(lines[1])
    altered["trials"][0]["x"][0] += 0.25
    path.write_text(lines[0] + json.dumps(altered) + "\n" + lines[2])
    with pytest.raises(RunLogError, match="asked other points"):
        run_job(job, tmp_path)


def test_a_stop_keeps_what_was_done(tmp_path: Path) -> None:
    answers = iter([False, False, True])
    with pytest.raises(RunStopped):
        run_job(MEBO, tmp_path, stop=lambda: next(answers))
    X, _ = _trace(MEBO, tmp_path)
    assert 0 < len(X) < 16
    assert run_job(MEBO, tmp_path)["resumed"]


def test_parallel_runs_equal_single_ones_and_are_not_repeated(tmp_path: Path) -> None:
    jobs = make_jobs(["random", "sobol"], [HIMMELBLAU], range(2), **SMALL)
    outcome = run_jobs(jobs, tmp_path / "two", workers=2, progress=io.StringIO())
    assert [r["key"] for r in outcome.results] == [job.key for job in jobs]
    for job, result in zip(jobs, outcome.results, strict=True):
        assert run_job(job, tmp_path / "one")["found_values"] == result["found_values"]
        for a, b in zip(_trace(job, tmp_path / "one"), _trace(job, tmp_path / "two"), strict=True):
            np.testing.assert_array_equal(a, b)
    before = (tmp_path / "two" / RESULTS_FILE).read_bytes()
    again = run_jobs(jobs, tmp_path / "two", workers=2, progress=io.StringIO())
    assert again.results == outcome.results
    assert (tmp_path / "two" / RESULTS_FILE).read_bytes() == before


def test_a_run_in_error_is_told_and_does_not_stop_the_others(tmp_path: Path) -> None:
    jobs = [Job("random", Cec2013("nowhere"), 0, **SMALL), Job("random", HIMMELBLAU, 0, **SMALL)]
    outcome = run_jobs(jobs, tmp_path, progress=io.StringIO())
    assert [key for key, _ in outcome.failures] == [jobs[0].key]
    assert "function must be one of" in outcome.failures[0][1]
    assert [r["key"] for r in outcome.results] == [jobs[1].key]


def test_a_torn_result_is_written_again_from_the_runs_log(tmp_path: Path) -> None:
    jobs = make_jobs(["random"], [HIMMELBLAU], range(2), **SMALL)
    first = run_jobs(jobs, tmp_path, progress=io.StringIO())
    path = tmp_path / RESULTS_FILE
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 40])
    assert len(load_results(tmp_path)) == 1
    second = run_jobs(jobs, tmp_path, progress=io.StringIO())
    assert [r["found"] for r in second.results] == [r["found"] for r in first.results]
    assert len(load_results(tmp_path)) == 2


def test_results_of_another_format_are_made_again_from_the_logs(tmp_path: Path) -> None:
    job = Job("random", HIMMELBLAU, 0, **SMALL)
    first = run_jobs([job], tmp_path, progress=io.StringIO()).results[0]
    path = tmp_path / RESULTS_FILE
    path.write_text(json.dumps({"format": 0, "key": job.key}) + "\n")
    again = run_jobs([job], tmp_path, progress=io.StringIO()).results[0]
    assert again["resumed"]
    assert again["found_values"] == first["found_values"]


def test_results_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / RESULTS_FILE).write_text("nonsense\n{}\n")
    with pytest.raises(RunLogError, match="line 1"):
        load_results(tmp_path)


def test_bad_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidSettingsError, match="workers"):
        run_jobs([MEBO], tmp_path, workers=0)
    with pytest.raises(InvalidSettingsError, match="same run"):
        run_jobs([MEBO, MEBO], tmp_path)


_SCRIPT = """
import sys
from pathlib import Path
from mebo_grasp.experiments.objectives import cec2013 as cec2013_objective
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.runs.job import make_jobs
from mebo_grasp.experiments.runs.runner import run_jobs
jobs = make_jobs(["mebo"], [Cec2013("vincent_2d")], [0, 1], budget=90, n_initial=10)
outcome = run_jobs(jobs, Path(sys.argv[1]), workers=1)
sys.exit(130 if outcome.interrupted else 0)
"""


def _start(out: Path) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    return subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, str(out)],
        env=environment,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _wait_for_tells(out: Path, count: int) -> None:
    limit = time.monotonic() + 60.0
    while time.monotonic() < limit:
        if sum(path.read_bytes().count(b'"tell"') for path in out.rglob("seed-*.jsonl")) >= count:
            return
        time.sleep(0.02)
    pytest.fail("the runs did not begin within a minute")


def _traces(out: Path) -> dict[str, list[list[float]]]:
    return {path.name: read_trace(path).X.tolist() for path in sorted(out.rglob("seed-*.jsonl"))}


@pytest.mark.slow
def test_killed_and_interrupted_benchmarks_continue_to_the_same_traces(tmp_path: Path) -> None:
    out = tmp_path / "broken"
    killed = _start(out)
    _wait_for_tells(out, 30)
    killed.kill()
    killed.wait(30)
    time.sleep(1.0)
    quiet = _traces(out)
    time.sleep(0.5)
    # The worker went with its parent: nobody writes any more.
    assert _traces(out) == quiet
    assert sum(len(trace) for trace in quiet.values()) < 180

    interrupted = _start(out)
    _wait_for_tells(out, sum(len(trace) for trace in quiet.values()) + 3)
    os.killpg(interrupted.pid, signal.SIGINT)
    assert interrupted.wait(60) == 130
    assert sum(len(trace) for trace in _traces(out).values()) < 180

    for seed in (0, 1):
        job = Job("mebo", Cec2013("vincent_2d"), seed, budget=90, n_initial=10)
        run_job(job, out)
        run_job(job, tmp_path / "whole")
    assert _traces(out) == _traces(tmp_path / "whole")


def test_a_run_of_an_ended_session_stops_and_one_of_the_present_session_goes_on(tmp_path: Path) -> None:
    (tmp_path / ".session").write_text("present")
    assert _work(MEBO, tmp_path, "ended")["kind"] == "stopped"
    assert _work(MEBO, tmp_path, "present")["kind"] == "result"


def test_what_other_settings_began_is_not_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_job(MEBO, tmp_path)
    monkeypatch.setattr(Cec2013, "told", lambda *_: {"num_solutions": 7})
    with pytest.raises(RunLogError, match="other settings"):
        run_job(MEBO, tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(Cec2013, "make", lambda *_: get_problem("vincent_2d"))
    with pytest.raises(RunLogError, match="another search space"):
        run_job(MEBO, tmp_path)


def test_results_of_other_settings_are_not_taken_for_these(tmp_path: Path) -> None:
    job = Job("random", HIMMELBLAU, 0, **SMALL)
    run_jobs([job], tmp_path, progress=io.StringIO())
    path = tmp_path / RESULTS_FILE
    path.write_text(path.read_text().replace('"transformed": false', '"transformed": true'))
    with pytest.raises(RunLogError, match="with transformed True, not False"):
        run_jobs([job], tmp_path, progress=io.StringIO())


def test_two_workers_do_not_write_one_log(tmp_path: Path) -> None:
    job = Job("random", HIMMELBLAU, 0, **SMALL)
    job.log_path(tmp_path).parent.mkdir(parents=True)
    with run_job_module._sole_writer(job.log_path(tmp_path)), pytest.raises(RunLogError, match="in use"):
        run_job(job, tmp_path)
    assert run_job(job, tmp_path)["evaluations"] == 16


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    with _sole_user(tmp_path), pytest.raises(RunLogError, match="in use"):
        run_jobs([MEBO], tmp_path, progress=io.StringIO())
