"""The thesis's own search boxes: the numbers of its scenes, moved into the built-in objects' frames, and of use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import qmc

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import GraspOutcome
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings
from mebo_grasp.nodes.exploration_plan import make_plan
from mebo_grasp.nodes.settings import OptimizerNodeSettings

FOLDER = Path(__file__).parents[3] / "params" / "thesis"
FILES = sorted(path.stem for path in FOLDER.glob("*.yaml"))


def parameters(name: str, node: str = "optimizer_node") -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())[node]["ros__parameters"]
    return data


def settings(name: str) -> OptimizerNodeSettings:
    values = parameters(name)
    return OptimizerNodeSettings(
        object=values["object"],
        space=values["space"],
        lower_bounds=tuple(values["lower_bounds"]),
        upper_bounds=tuple(values["upper_bounds"]),
    )


def test_there_is_a_box_for_each_object_and_space_of_the_thesis() -> None:
    assert [f"{name}_{space}" for name in ("bottle", "drill", "vase") for space in ("pose", "position")] == FILES
    for name in FILES:
        for node in ("hand_node", "solution_set_node"):
            assert parameters(name, node)["object"] == parameters(name)["object"]


def test_the_bottles_boxes_by_hand() -> None:
    """World minus the object's place (26, -46, 60) minus the middle of its mesh (-0.43, 0, -100.24), millimetres."""
    np.testing.assert_allclose(
        1000.0 * np.array(parameters("bottle_position")["lower_bounds"]), [-75.57, 26.0, -109.76], atol=1e-9
    )
    np.testing.assert_allclose(
        parameters("bottle_pose")["upper_bounds"], [-0.01057, 0.071, 0.10524, -0.78, 0.4, 0.78], atol=1e-12
    )


def test_the_sizes_of_the_boxes_are_the_thesiss() -> None:
    sizes = {name: np.subtract(parameters(name)["upper_bounds"], parameters(name)["lower_bounds"]) for name in FILES}
    np.testing.assert_allclose(sizes["bottle_position"], [0.053, 0.055, 0.184], atol=1e-9)
    np.testing.assert_allclose(sizes["vase_position"], [0.080, 0.075, 0.240], atol=1e-9)
    np.testing.assert_allclose(sizes["drill_position"], [0.030, 0.0515, 0.140], atol=1e-9)
    np.testing.assert_allclose(sizes["bottle_pose"], [0.05, 0.055, 0.215, 1.02, 0.8, 1.56], atol=1e-9)
    np.testing.assert_allclose(sizes["vase_pose"], [0.043, 0.037, 0.165, 1.16, 0.2, 0.9], atol=1e-9)
    np.testing.assert_allclose(sizes["drill_pose"], [0.05, 0.052, 0.165, 0.6, 0.2, 1.1], atol=1e-9)


@pytest.mark.parametrize("name", FILES)
def test_the_box_is_taken_by_the_optimizer_and_holds_grasps(name: str) -> None:
    plan = make_plan(settings(name))
    space = plan.pose_space
    points = qmc.scale(qmc.Halton(space.dimension, rng=np.random.default_rng(1)).random(48), space.lower, space.upper)
    target = TargetObject.builtin(parameters(name)["object"])
    with GraspSimulator(target, HandModel.load("icub_left"), TrialSettings(compute_volume=False)) as simulator:
        outcomes = [simulator.trial(space.to_pose(x)).outcome for x in points]
    assert outcomes.count(GraspOutcome.GRASPED) >= 1


def test_an_exploration_can_search_about_a_facet() -> None:
    plan = make_plan(OptimizerNodeSettings(object="drill", space="facet", facet="-y"))
    assert plan.search_space.names == ("along", "across", "towards", "roll", "pitch", "yaw")
    x = np.random.default_rng(3).uniform(plan.search_space.lower, plan.search_space.upper)
    found = plan.point_of(plan.pose_space.to_pose(x))
    assert found is not None
    np.testing.assert_allclose(found, x, atol=1e-9)
    assert plan.pose_space.to_pose(np.zeros(6)).position[1] < 0.0
    with pytest.raises(InvalidSettingsError, match="sideways"):
        make_plan(OptimizerNodeSettings(space="facet", facet="sideways"))
