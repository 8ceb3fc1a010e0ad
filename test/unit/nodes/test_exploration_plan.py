"""The node's parameters arrive in the optimizer."""

from typing import Any

import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.nodes.exploration_plan import make_plan
from mebo_grasp.nodes.settings import OptimizerNodeSettings
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
