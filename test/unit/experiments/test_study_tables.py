"""Tables, plots and report of an experiment, against runs made by hand."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from mebo_grasp.experiments.objective import Objective, Trace
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.reports import study_plots
from mebo_grasp.experiments.reports.study_plots import mean_curves
from mebo_grasp.experiments.reports.study_tables import CSV_HEADER, csv_text, make_tables, solution_table
from mebo_grasp.experiments.reports.table import Table
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.scores.study_scores import METRICS, Run

BOTTLE = GraspObjective("bottle", quality="simox_epsilon", bounds="thesis")
NAN = float("nan")


def _run(
    method: str,
    seed: int,
    y: list[float],
    objective: Objective = BOTTLE,
    X: Any = None,
    chosen: Any = (0,),
    **result: Any,
) -> Run:
    points = np.array(X if X is not None else [[0.0, 0.0, 0.05 * k] for k in range(len(y))], dtype=np.float64)
    record = {"resumed": False, "optimizer_cpu_seconds": 2.0, **result}
    trace = Trace(points, np.array(y), [[1, 2]], points[list(chosen)], names=("x", "y", "z"))
    return Run(Job(method, objective, seed), record, trace)


def _table(metric: str, runs: list[Run]) -> Table:
    return make_tables([metric], runs)[0].table()


def _row(table: Table, name: str) -> tuple[str, ...]:
    return next(row[1:] for row in table.rows if row[0] == name)


def test_cells_have_mean_deviation_and_number_and_the_thesis_stands_beside() -> None:
    runs = [_run("robot", 0, [0.5, NAN, 0.8]), _run("robot", 1, [0.6]), _run("random", 0, [0.4])]
    table = _table("best", runs)
    assert table.header == ("method", "bottle")
    assert _row(table, "robot") == ("**0.700 ± 0.141 (2)**",)
    assert _row(table, "random") == ("0.400 (1)",)
    assert _row(table, "*thesis ROBOT*") == ("0.829 ± 0.011",)


def test_only_what_is_significantly_worse_is_marked() -> None:
    runs = []
    for seed in range(7):
        runs += [_run("a", seed, [0.8 + 0.01 * seed]), _run("b", seed, [0.5 + 0.012 * seed])]
        runs += [_run("c", seed, [0.8 + 0.01 * seed + (0.02 if seed % 2 else -0.03)])]
    table = _table("best", runs)
    assert _row(table, "a")[0].startswith("**")
    assert _row(table, "b")[0].endswith("†")
    assert not _row(table, "c")[0].endswith("†")


def test_sets_are_scored_as_the_thesis_does() -> None:
    # 0, 50, 100 and 120 mm: the last two are nearer than 40 mm and count once.
    X = [[0.0, 0.0, z] for z in (0.0, 0.05, 0.1, 0.12, 0.3)]
    table = _table("set", [_run("cl_mebo", 0, [0.6, 0.5, 0.4, 0.3, 0.9], X=X, chosen=(0, 1, 2, 3))])
    assert table.header == ("method", "bottle: M_d", "MGOs")
    assert _row(table, "cl_mebo") == ("**3.00 (1)**", "**0.450 (1)**")
    assert _row(table, "*thesis CL-MEBO*") == ("3.70 ± 0.45", "0.646 ± 0.038")


def test_diversity_is_counted_in_weighted_distances() -> None:
    run = _run("cl_mebo", 0, [0.6, 0.5], X=[[0.0, 0.0, 0.0], [0.0, 0.03, 0.03]], chosen=(0, 1))
    assert run.diverse == 2
    weighted = replace(run.trace, weights=np.array([1.0, 0.1, 1.0]))
    assert replace(run, trace=weighted).diverse == 1


def test_occlusion_and_retention_by_hand() -> None:
    # The small occlusion blocks -49.8 to 70.2 mm of the built-in bottle, the large one all above -49.8 mm.
    X = [[0.0, 0.0, z] for z in (0.0, -0.03, -0.06, 0.08)]
    runs = [_run("mebo", 0, [0.8, 0.72, 0.4, 0.6], X=X, chosen=(0, 3))]
    assert _row(_table("occlusion", runs), "mebo") == ("**0.600 (1)**", "**0.400 (1)**")
    shares = METRICS["retention"].compute(runs[0])
    assert shares["archive 20 mm"] == pytest.approx(0.72 / 0.8)
    assert shares["archive 40 mm"] == pytest.approx(0.6 / 0.8)
    assert shares["set 20 mm"] == shares["set 60 mm"] == pytest.approx(0.6 / 0.8)


def test_our_epsilon_is_not_set_beside_the_thesiss() -> None:
    table = _table("best", [_run("robot", 0, [0.5], GraspObjective("bottle", bounds="thesis"))])
    assert [row[0] for row in table.rows] == ["robot"]


def test_acquisition_study_stands_beside_its_own_tables() -> None:
    result = {"n_optima": 5, "found": 5, "found_values": [1.0], "first_all": 0.2, "last_change": 0.4}
    objective = Cec2013("equal_maxima")
    runs = [_run("mebo_ei", 0, [1.0], objective, **result), _run("mebo", 0, [1.0], objective, **result)]
    table = _table("optima", runs)
    assert _row(table, "*thesis EI*")[:4] == ("1.000", "1.00", "-", "0.938")
    alone = _table("optima", runs[1:])
    assert _row(alone, "*thesis ROBOT*")[3] == "0.848"
    assert _row(alone, "*thesis BBO-LP (GPyOpt)*")[3] == "0.084"
    variance = _table("batch_variance", [_run("mebo_ei", 0, [1.0] * 3, Cec2013("himmelblau"))])
    assert _row(variance, "*thesis EI*") == ("0.4110", "0.2840")


def test_lower_is_better_where_it_is_and_nothing_is_best_where_no_value_is() -> None:
    runs = [
        _run("a", 0, [0.1] * 3),
        _run("b", 0, [0.1] * 3, optimizer_cpu_seconds=1.0),
        _run("c", 0, [0.1] * 3),
    ]
    assert _row(_table("cost", runs), "b")[0].startswith("**1.0")
    assert "**" not in _table("batch_variance", runs).markdown()
    assert make_tables(["cost"], [_run("a", 0, [0.1], resumed=True)]) == []


def test_many_objectives_stand_in_rows_with_their_mean() -> None:
    objectives = [GraspObjective(f"{k:03d}.obj", scale=0.015) for k in range(8)]
    runs = [_run("a", seed, [0.1 * k + seed], o) for seed in (0, 1) for k, o in enumerate(objectives)]
    table = _table("best", [*runs, _run("b", 0, [2.0], objectives[0])])
    assert table.header == ("", "a", "b")
    assert _row(table, "003") == ("**0.800 ± 0.707 (2)**", "-")
    # Mean over the eight objectives at each of the two seeds: 0.35 and 1.35; b has not run on all.
    assert _row(table, "mean over 8") == ("**0.850 ± 0.707 (2)**", "-")


def test_csv_has_a_row_for_each_cell_and_printed_figure() -> None:
    runs = [_run("robot", seed, [0.5 + seed]) for seed in range(2)]
    rows = list(csv.DictReader(io.StringIO(csv_text(make_tables(["best"], runs)))))
    assert tuple(rows[0]) == CSV_HEADER
    assert (rows[0]["method"], rows[0]["source"], rows[0]["mean"], rows[0]["runs"]) == (
        "robot",
        "measured",
        "1",
        "2",
    )
    thesis = {row["method"]: row["mean"] for row in rows if row["source"] == "thesis"}
    assert thesis["SO-MS"] == "0.834"
    assert len(rows) == 6


def test_solutions_are_those_of_the_best_run() -> None:
    runs = [_run("a", 0, [0.1, 0.2], chosen=(1, 0)), _run("a", 1, [0.3, 0.0], chosen=(0,))]
    table = solution_table(runs)
    assert table is not None
    assert table.rows == (("a", "1", "0.3000", "0", "0", "0"),)
    assert solution_table([]) is None


def test_curves_pass_over_what_is_missing() -> None:
    mean, sd = mean_curves([_run("a", 0, [NAN, 1.0, 0.0, 3.0]), _run("a", 1, [1.0, 2.0])])
    np.testing.assert_allclose(mean, [1.0, 1.5, 1.5, 2.5])
    np.testing.assert_allclose(sd, [0.0, 0.5**0.5, 0.5**0.5, 0.5**0.5])


@pytest.mark.parametrize(("initial", "lowest"), [(0, 0.2), (1, 0.2), (2, 0.5), (9, 0.8)])
def test_the_scale_begins_below_what_the_initial_design_found(initial: int, lowest: float) -> None:
    run = _run("a", 0, [0.2, 0.5, 0.8])
    run = replace(run, job=replace(run.job, n_initial=initial))
    figure = Figure()
    axes = figure.add_subplot()
    study_plots._draw(axes, [run], ["a"])
    assert axes.get_ylim()[0] == pytest.approx(0.9 * lowest)
