"""The same jobs on a local Dask cluster of two workers."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.runs.cluster import dask_pool
from mebo_grasp.experiments.runs.job import Job, make_jobs
from mebo_grasp.experiments.runs.results import RESULTS_FILE
from mebo_grasp.experiments.runs.run_trace import read_trace
from mebo_grasp.experiments.runs.runner import run_jobs

distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")

JOBS = make_jobs(["random", "mebo"], [Cec2013("himmelblau")], range(2), budget=25, n_initial=10)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    settings: dict[str, Any] = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster:
        yield cluster.scheduler_address


def test_runs_on_a_cluster_are_those_of_local_processes(address: str, tmp_path: Path) -> None:
    pool = dask_pool(address)
    there = run_jobs(JOBS, tmp_path / "there", workers=2, progress=io.StringIO(), pool=pool)
    here = run_jobs(JOBS, tmp_path / "here", workers=2, progress=io.StringIO())
    assert not there.failures
    assert [r["key"] for r in there.results] == [r["key"] for r in here.results] == [job.key for job in JOBS]
    for job in JOBS:
        ours, theirs = (read_trace(job.log_path(tmp_path / folder)) for folder in ("here", "there"))
        np.testing.assert_array_equal(ours.X, theirs.X)
        np.testing.assert_array_equal(ours.y, theirs.y)
    before = (tmp_path / "there" / RESULTS_FILE).read_bytes()
    run_jobs(JOBS, tmp_path / "there", workers=2, progress=io.StringIO())
    assert (tmp_path / "there" / RESULTS_FILE).read_bytes() == before


def test_a_cut_run_goes_on_and_a_failing_one_ends_alone(address: str, tmp_path: Path) -> None:
    run_jobs([JOBS[1]], tmp_path, progress=io.StringIO())
    path = JOBS[1].log_path(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    (tmp_path / RESULTS_FILE).unlink()
    bad = Job("random", Cec2013("nowhere"), 0, budget=25, n_initial=10)
    outcome = run_jobs([bad, JOBS[1]], tmp_path, progress=io.StringIO(), pool=dask_pool(address))
    assert [key for key, _ in outcome.failures] == [bad.key]
    assert outcome.results[0]["resumed"]
    assert path.read_bytes() == whole
