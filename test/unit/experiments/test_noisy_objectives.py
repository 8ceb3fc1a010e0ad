"""Experiments in which a recommended point is carried out with input noise: judge, log, table, plot, definitions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.definition import load_definition, make_definition
from mebo_grasp.experiments.objective import NoisyOutcome, Recommendation, Trace
from mebo_grasp.experiments.objectives.noisy import FACET_SPACES, NoisyFunction, NoisyGrasp
from mebo_grasp.experiments.problems import NOISY_INPUT_FUNCTIONS
from mebo_grasp.experiments.published import ubo_paper
from mebo_grasp.experiments.reports.report import write_report
from mebo_grasp.experiments.reports.study_plots import mark_first_split, outcome_curves
from mebo_grasp.experiments.reports.study_tables import make_tables
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.protocol import settings_of
from mebo_grasp.experiments.runs.run_job import RunStopped, run_job
from mebo_grasp.experiments.runs.run_trace import read_trace
from mebo_grasp.experiments.scores.study_scores import Run
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.surrogate.partition import grow

RKHS = NoisyFunction("rkhs")


def _job(method: str = "ubo", objective: Any = RKHS, seed: int = 3) -> Job:
    return Job(method, objective, seed, budget=10, n_initial=6, batch_size=1)


def test_a_point_is_judged_by_executions_with_the_noise_of_the_seed() -> None:
    with RKHS.open(7) as evaluator:
        assert evaluator.judge is not None
        found, again = (evaluator.judge(np.array([0.892362])) for _ in range(2))
        noise = 0.01 * np.random.default_rng([7, 1]).standard_normal(100)
        values = evaluator.function(0.892362 + noise[:, None])
    expected = [np.mean(values), np.std(values, ddof=1), np.min(values)]
    assert [found.mean, found.sd, found.worst] == pytest.approx(expected)
    assert (found.mean, found.sd, found.worst) == (again.mean, again.sd, again.worst)


def test_every_trial_after_the_initial_design_has_a_recommendation(tmp_path: Path) -> None:
    run_job(_job("bo"), tmp_path)
    found = read_trace(_job("bo").log_path(tmp_path)).recommended
    assert [item.evaluations for item in found] == [7, 8, 9, 10]
    run = Run.load(_job("bo"), {"solutions": []}, tmp_path)
    for item in run.trace.recommended:
        best = int(np.argmax(run.trace.y[: item.evaluations]))
        assert np.array_equal(item.x, run.trace.X[best])


def test_a_stopped_run_ends_with_the_recommendations_of_a_whole_one(tmp_path: Path) -> None:
    whole, parted = tmp_path / "whole", tmp_path / "parted"
    run_job(_job(), whole)
    asked = iter([False] * 8 + [True])
    with pytest.raises(RunStopped):
        run_job(_job(), parted, stop=lambda: next(asked))
    log = _job().log_path(parted)
    lines = log.read_text().splitlines(keepends=True)
    assert '"recommended"' in lines[-1]
    log.write_text("".join(lines[:-1]))  # Killed after the value and before what it makes of it.
    run_job(_job(), parted)
    expected, found = (read_trace(_job().log_path(folder)).recommended for folder in (whole, parted))
    assert [item.evaluations for item in expected] == [7, 8, 9, 10]
    for a, b in zip(expected, found, strict=True):
        assert (a.evaluations, a.x.tolist(), a.outcome.mean) == (b.evaluations, b.x.tolist(), b.outcome.mean)


def test_methods_are_told_the_papers_protocol() -> None:
    method, settings = settings_of(_job("tgp_w2_mcmc"))
    assert (method, settings.surrogate, settings.learning) == ("bo", "treed_gp", "mcmc")
    assert settings.tree_weight_power == 2.0
    assert (settings.relearn_period, settings.min_leaf, settings.improvement_margin) == (1, 8, 0.01)
    assert settings.input_noise == InputNoise((0.01,))
    assert settings.noise_variance == 1e-6
    assert settings_of(_job("ubo", NoisyGrasp("mug")))[1].noise_variance == 1e-4
    assert settings_of(_job("basin_search_safe", NoisyGrasp("mug")))[1].safe


def test_settings_out_of_range_are_refused_by_name() -> None:
    for settings, message in (
        ({"facet": "up"}, "facet must be one of"),
        ({"space": "plane"}, "space must be one of position, pose, synergy"),
        ({"executions": 1}, "executions at least 2"),
        ({"input_sd": -0.1}, "input_sd must be finite and at least 0"),
    ):
        with pytest.raises(InvalidSettingsError, match=message):
            NoisyGrasp("bottle", **settings).check()
    with pytest.raises(InvalidSettingsError, match="rkhs, gramacy, gaussian_mixture"):
        NoisyFunction("teapot").check()


def test_a_grasp_of_the_papers_facet_is_good_and_its_other_increments_rest() -> None:
    objective = NoisyGrasp("glass", executions=4, engine="fast")
    with objective.open(0) as evaluator:
        assert evaluator.space.names == ("along", "across", "towards")
        x = np.array([0.018, 0.016, 0.048])
        assert evaluator.function(x[None])[0] > 0.4
        assert evaluator.judge is not None
        outcome = evaluator.judge(x)
    assert 0.0 <= outcome.worst <= outcome.mean < 0.8
    assert outcome.sd > 0.0
    with replace(objective, space="synergy").open(0) as evaluator:
        assert evaluator.space.dim == FACET_SPACES["synergy"] == 7


def test_both_experiments_are_whole_and_every_figure_of_the_paper_has_its_runs() -> None:
    ubo, tgp = load_definition("paper-ubo"), load_definition("paper-tgp")
    runs: dict[str, set[int]] = {}
    for job in (*ubo.jobs, *tgp.jobs):
        runs.setdefault(job.cell, set()).add(job.seed)
    for cell, seeds in runs.items():
        least = (3 if "facet" in cell else 10) if "_mcmc" in cell else (30 if "facet" in cell else 100)
        assert len(seeds) >= least, cell
    treed = {job.objective for job in tgp.jobs}
    assert {o.problem for o in treed if isinstance(o, NoisyFunction)} == set(NOISY_INPUT_FUNCTIONS)
    grasps = [o for o in treed if isinstance(o, NoisyGrasp)]
    assert {f"{o.object}{o.facet}" for o in grasps} == {"bottle+y", "bottle+z", "mug+y", "glass+y", "drill+y"}
    for o in grasps:
        assert len(ubo_paper.grasp_figures(o.object, o.facet, o.space, "best")) == 5
    assert {j.method for j in ubo.jobs} >= {"bo", "ubo", "bo_mcmc", "ubo_mcmc", "basin_search_safe"}


def test_a_part_may_have_seeds_of_its_own() -> None:
    parts = [{"seeds": 3}, {"methods": ["ubo"], "seeds": [5, 0]}]
    content = {"objective": {"name": "noisy_function", "problem": "rkhs"}, "methods": ["bo"], "parts": parts}
    jobs = make_definition("x", content).jobs
    assert [(job.method, job.seed) for job in jobs] == [
        ("bo", 0),
        ("ubo", 5),
        ("bo", 1),
        ("ubo", 0),
        ("bo", 2),
    ]


def test_a_setting_reaches_the_parts_whose_objective_has_it() -> None:
    jobs = load_definition("paper-ubo", {"engine": "fast", "seeds": 1}).jobs
    assert {job.objective.engine for job in jobs if isinstance(job.objective, NoisyGrasp)} == {"fast"}
    assert {job.objective.label for job in jobs} >= {"rkhs", "gaussian_mixture"}
    with pytest.raises(InvalidSettingsError, match="no part's objective has a setting 'teapot'"):
        load_definition("paper-ubo", {"teapot": 1})


def _run(method: str, seed: int, means: list[float]) -> Run:
    notes = tuple(
        Recommendation(7 + k, np.array([0.1]), NoisyOutcome(mean, 0.5, mean - 1.0)) for k, mean in enumerate(means)
    )
    trace = Trace(np.array([[0.1]]), np.array([1.0]), [], np.array([[0.1]]), notes, ("x",))
    result = {"resumed": False, "optimizer_cpu_seconds": 1.0, "versions": {"python": "3"}}
    return Run(_job(method, seed=seed), result, trace)


def test_the_table_has_the_last_outcome_and_the_papers_beside() -> None:
    table = make_tables(["outcome"], [_run("ubo", 0, [1.0, 4.9]), _run("ubo", 1, [1.0, 4.7])])[0]
    rows = {row[0]: row[1:] for row in table.table().rows}
    assert rows["ubo"][0].startswith("**4.8000 ± 0.1414 (2)")
    assert rows["*paper UBO*"] == ("4.9340", "0.0650", "4.6570")
    printed = [row for row in table.csv_rows() if row[5] == "paper" and row[4] == "BO"]
    assert [(row[3], row[6], row[8]) for row in printed] == [
        ("mean", "4.863", "100"), ("sd", "0.554", "100"), ("worst", "2.881", "100"),
    ]  # fmt: skip


def test_the_first_split_of_a_tree_is_read_and_drawn(tmp_path: Path) -> None:
    job = replace(_job("tgp_winf"), budget=19, n_initial=14)
    run_job(job, tmp_path)
    run = Run.load(job, {"solutions": []}, tmp_path)
    grown = [len(list(grow(run.trace.X[:n], run.trace.y[:n], 8).leaves())) for n in range(14, 19)]
    assert grown[:2] == [1, 1]  # A leaf needs 8 observations.
    split = run.trace.first_split
    assert split == 14 + grown.index(2)
    figure = Figure()
    mark_first_split(figure.add_subplot(), [run, replace(run, trace=replace(run.trace, first_split=None))])
    assert np.all(np.asarray(figure.axes[0].lines[0].get_xdata()) == split)


def test_curves_have_the_confidence_interval_of_the_mean() -> None:
    runs = [_run("ubo", seed, [1.0, value]) for seed, value in enumerate((4.0, 5.0, 6.0))]
    evaluations, mean, half = outcome_curves(runs, "mean")
    assert evaluations.tolist() == [7, 8]
    assert mean.tolist() == [1.0, 5.0]
    assert half == pytest.approx([0.0, 4.302653 / np.sqrt(3.0)])


def test_the_report_has_both_kinds_of_curves(tmp_path: Path) -> None:
    definition = make_definition(
        "x",
        {
            "objective": {"name": "noisy_function", "problem": "rkhs"}, "methods": ["ubo"], "seeds": 1,
            "metrics": ["best", "outcome"],
        },
    )  # fmt: skip
    report = write_report(definition, [_run("ubo", 0, [1.0, 4.9])], tmp_path, "command")
    assert [path.name for path in report.pictures] == ["best_values-functions.png", "outcomes-functions.png"]
    assert "*paper UBO*" in report.markdown.read_text()


def test_by_default_every_metric_is_asked_for_and_those_that_do_not_apply_are_left_out(tmp_path: Path) -> None:
    definition = make_definition(
        "x", {"objective": {"name": "noisy_function", "problem": "rkhs"}, "methods": ["ubo"], "seeds": 1}
    )
    report = write_report(definition, [_run("ubo", 0, [1.0, 4.9])], tmp_path, "command")
    assert [table.title.split(":")[0] for table in report.tables] == [
        "Best value", "Outcome of the recommended point", "Cost of the optimizer", "Solutions",
    ]  # fmt: skip
    assert "found_optima" not in report.markdown.read_text()
