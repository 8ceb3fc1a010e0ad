"""The node's parameters arrive in the optimizer."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.nodes.exploration_plan import make_plan
from mebo_grasp.nodes.settings import OptimizerNodeSettings
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.optimizer import Optimizer


def test_the_surrogates_parameters_reach_the_method() -> None:
    chosen: dict[str, Any] = {
        "kernel": "additive_squared_exponential",
        "warp": "kumaraswamy",
        "learning": "mcmc",
    }
    plan = make_plan(OptimizerNodeSettings(method="bo_ucb", **chosen))
    optimizer = plan.open_optimizer()
    assert isinstance(optimizer, Optimizer)
    assert {name: getattr(optimizer.settings, name) for name in chosen} == chosen


def test_contradicting_parameters_are_refused_when_the_optimizer_is_made() -> None:
    plan = make_plan(OptimizerNodeSettings(method="mebo", kernel="evidence", learning="mcmc"))
    with pytest.raises(InvalidSettingsError, match="leave these at their defaults"):
        plan.open_optimizer()


@pytest.mark.parametrize(
    ("change", "named"),
    [({"facet": "-y"}, "facet"), ({"object": "mug"}, "object"), ({"hand": "icub_right"}, "hand")],
)
def test_a_run_log_is_not_resumed_where_its_points_are_other_grasps(
    change: dict[str, Any], named: str, tmp_path: Path
) -> None:
    begun = OptimizerNodeSettings(
        space="facet", lower_bounds=(-0.1,) * 6, upper_bounds=(0.1,) * 6, run_log=str(tmp_path / "run.jsonl")
    )
    for _ in range(2):
        opened = make_plan(begun).open_optimizer()
        assert isinstance(opened, LoggedOptimizer)
        opened.close()
    with pytest.raises(RunLogError, match=f"belongs to a run with another {named} "):
        make_plan(replace(begun, **change)).open_optimizer()
    LoggedOptimizer.resume(begun.run_log).close()


def test_a_run_log_that_does_not_tell_its_object_is_resumed(tmp_path: Path) -> None:
    settings = OptimizerNodeSettings(run_log=str(tmp_path / "run.jsonl"))
    plan = make_plan(settings)
    LoggedOptimizer.create(
        settings.run_log, plan.search_space, settings.method, plan.optimizer_settings, settings.seed
    ).close()
    opened = plan.open_optimizer()
    assert isinstance(opened, LoggedOptimizer)
    opened.close()
