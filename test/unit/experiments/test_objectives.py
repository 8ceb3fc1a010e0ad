"""Objectives of others: by entry point, by path, and what is none."""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.definition import make_definition
from mebo_grasp.experiments.objective import Evaluator, Objective, WantedSet, pointwise
from mebo_grasp.experiments.objectives.registry import make_objective, objective_names
from mebo_grasp.experiments.runs.job import Job, make_jobs
from mebo_grasp.experiments.runs.run_job import run_job
from mebo_grasp.experiments.runs.runner import run_jobs
from mebo_grasp.experiments.scores.study_scores import METRICS, Run
from mebo_grasp.optimization.search_space import SearchSpace

MODULE = """
from contextlib import contextmanager
from dataclasses import dataclass
from mebo_grasp.experiments.objective import Evaluator, Objective, pointwise
from mebo_grasp.optimization.search_space import SearchSpace

@dataclass(frozen=True)
class Hill(Objective):
    top: float = 0.5

    @property
    def label(self):
        return f"hill_{self.top:g}"

    @contextmanager
    def open(self, seed):
        yield Evaluator(SearchSpace(("height",), [0.0], [1.0]), pointwise(lambda x: -abs(x[0] - self.top)))

@dataclass(frozen=True)
class Nameless(Hill):
    named: str = ""

    @property
    def label(self):
        return f"hill/../{self.named}"

@dataclass(frozen=True)
class Seeded(Hill):
    seed: int = 3

@dataclass(frozen=True)
class Same(Hill):
    @property
    def label(self):
        return "same"

not_an_objective = 3
"""


@dataclass(frozen=True)
class Ridge(Objective):
    """Two equal summits, and a part in which every trial fails."""

    broken: bool = False

    @property
    def label(self) -> str:
        return f"ridge_{self.broken}"

    def wanted_set(self, seed: int) -> WantedSet:
        del seed
        return WantedSet(2, 0.3)

    @contextmanager
    def open(self, seed: int) -> Iterator[Evaluator]:
        del seed

        def value(x: np.ndarray) -> float:
            if self.broken:
                raise ZeroDivisionError("the oven is cold")
            return math.inf if x[1] > 0.8 else math.cos(12.0 * x[0]) - float(x[1])

        yield Evaluator(SearchSpace.unit_cube(2), pointwise(value))


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package with an entry point, as pip leaves it."""
    (tmp_path / "hills_of_test.py").write_text(MODULE)
    info = tmp_path / "hills_of_test-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hills-of-test\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[mebo_grasp.objectives]\nhill = hills_of_test:Hill\nwrong = hills_of_test:not_an_objective\n"
        "gone = hills_of_test:Gone\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("hills_of_test", None)


@pytest.mark.usefixtures("installed")
def test_an_entry_point_is_an_objective_like_any_other(tmp_path: Path) -> None:
    assert "hill" in objective_names()
    objective = make_objective("hill", {"top": 0.25})
    result = run_job(Job("random", objective, 0, budget=40, n_initial=10), tmp_path)
    assert result["job"]["top"] == 0.25
    assert -0.1 < result["best_value"] <= 0.0
    assert make_objective("hills_of_test:Hill", {"top": 0.25}).label == objective.label


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mountain", "must be one of cec2013, grasp, noisy_function, noisy_grasp, gone, hill, wrong"),
        ("wrong", "it must be a frozen dataclass derived from"),
        ("gone", "cannot be loaded"),
        ("no_such_module:Hill", "cannot be loaded: No module named"),
        ("hills_of_test:Mountain", "cannot be loaded"),
        ("hills_of_test:Nameless", "must be made of letters"),
        ("hills_of_test:Seeded", "has a setting seed, which names a part of a run"),
    ],
)
def test_what_is_no_objective_is_refused(name: str, message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        make_objective(name, {})


@pytest.mark.usefixtures("installed")
def test_objectives_that_one_label_would_mix_up_are_refused() -> None:
    content = {"objective": {"name": "hills_of_test:Same", "top": [0.2, 0.4]}, "methods": ["random"]}
    with pytest.raises(InvalidSettingsError, match="have one label, 'same'"):
        make_definition("n", content)


def test_failed_trials_are_told_and_logged_and_scores_pass_them_over(tmp_path: Path) -> None:
    for method in ("basin_search", "mebo"):
        job = Job(method, Ridge(), 1, budget=25, n_initial=15)
        result = run_job(job, tmp_path)
        records = [json.loads(line) for line in job.log_path(tmp_path).read_text().splitlines()]
        failed = sum(record["kind"] == "tell_failed" for record in records)
        run = Run.load(job, result, tmp_path)
        assert failed == np.count_nonzero(np.isnan(run.trace.y)) > 0
        assert np.all(run.trace.X[np.isnan(run.trace.y), 1] > 0.8)
        assert METRICS["best"].compute(run)["best"] == result["best_value"]
        assert METRICS["set"].compute(run)["M_d"] == 2.0
        assert METRICS["occlusion"].compute(run) == {}


def test_an_objective_that_raises_ends_its_run_alone(tmp_path: Path) -> None:
    jobs = make_jobs(["random"], [Ridge(broken=True), Ridge()], [0], budget=20, n_initial=5)
    outcome = run_jobs(jobs, tmp_path, progress=io.StringIO())
    assert [result["key"] for result in outcome.results] == [jobs[1].key]
    assert "the oven is cold" in outcome.failures[0][1]


def test_a_function_with_another_number_of_values_is_refused() -> None:
    evaluator = Evaluator(SearchSpace.unit_cube(1), lambda X: np.zeros(len(X) + 1))
    with pytest.raises(InvalidSettingsError, match="2 points need as many values"):
        evaluator(np.zeros((2, 1)))
