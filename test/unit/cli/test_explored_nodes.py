"""What ``explore`` starts its nodes with, and which folders it continues."""

import argparse
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import yaml

from mebo_grasp.cli import explore
from mebo_grasp.cli.explored_nodes import HAND_OPTIONS, NODES, OPTIMIZER_OPTIONS, check_continues, node_parameters
from mebo_grasp.cli.search_box import searched_space
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes.settings import HandNodeSettings, OptimizerNodeSettings, SolutionSetNodeSettings

SETTINGS: dict[str, type[Any]] = {
    "solution_set_node": SolutionSetNodeSettings,
    "hand_node": HandNodeSettings,
    "optimizer_node": OptimizerNodeSettings,
}
OTHERS = {
    "object": "mug", "scale": "0.5", "concave": "parts", "hand": "icub_right", "metric": "volume",
    "engine": "fast", "friction": "0.7", "edges": "6", "contact": "soft",
    "space": "pose", "method": "mebo", "kernel": "evidence", "warp": "kumaraswamy", "learning": "mcmc",
    "surrogate": "treed_gp", "position-noise": "0.01", "rotation-noise": "0.2", "seed": "2", "budget": "200",
    "initial": "30", "size": "5", "min-distance": "0.03", "facet": "+z", "synergies": "3",
}  # fmt: skip
TARGET, HAND = TargetObject.load("bottle"), HandModel.load("icub_left")


def options_of(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    explore.add_arguments(parser)
    return parser.parse_args(words)


def parameters_of(folder: Path, *words: str) -> dict[str, dict[str, object]]:
    options = options_of(*words)
    return node_parameters(options, folder, searched_space(options, TARGET, HAND))


def store(folder: Path, parameters: dict[str, dict[str, object]]) -> None:
    (folder / "trials.db").touch()
    (folder / "run.jsonl").touch()
    for node, values in parameters.items():
        (folder / f"{node}.yaml").write_text(yaml.safe_dump({node: {"ros__parameters": values}}))


def test_all_parameters_are_the_nodes_own(tmp_path: Path) -> None:
    parameters = parameters_of(tmp_path)
    assert tuple(parameters) == NODES
    for node, values in parameters.items():
        assert set(values) <= {field.name for field in fields(SETTINGS[node])}, node


@pytest.mark.parametrize("option", [*HAND_OPTIONS.values(), *(o for o in OPTIMIZER_OPTIONS.values() if o != "safe")])
def test_a_run_is_continued_with_the_same_kind_of_trials_and_the_same_settings_only(
    option: str, tmp_path: Path
) -> None:
    before = parameters_of(tmp_path)
    other = parameters_of(tmp_path, f"--{option}", OTHERS[option])
    check_continues(tmp_path, other)
    store(tmp_path, before)
    check_continues(tmp_path, before)
    with pytest.raises(InvalidSettingsError, match=rf"--{option} .*, not {re.escape(OTHERS[option])}: .*--restart"):
        check_continues(tmp_path, other)


def test_a_run_is_continued_within_the_same_bounds_only(tmp_path: Path) -> None:
    store(tmp_path, parameters_of(tmp_path, "--bounds", "z=0.0:0.1"))
    check_continues(tmp_path, parameters_of(tmp_path, "--bounds", "z=0:0.1"))
    with pytest.raises(InvalidSettingsError, match=r"--bounds .*, not .*: .*--restart"):
        check_continues(tmp_path, parameters_of(tmp_path))


def test_a_budget_may_be_raised(tmp_path: Path) -> None:
    store(tmp_path, parameters_of(tmp_path, "--budget", "100"))
    assert check_continues(tmp_path, parameters_of(tmp_path, "--budget", "100")) is None
    assert check_continues(tmp_path, parameters_of(tmp_path, "--budget", "300")) == 100


def test_a_run_of_before_there_was_a_choice_is_continued(tmp_path: Path) -> None:
    now = parameters_of(tmp_path)
    store(tmp_path, {"hand_node": {"object": "bottle", "object_scale": 1.0, "hand": "icub_left"}})
    check_continues(tmp_path, now)


@pytest.mark.parametrize("text", ["", "hand_node: [", "hand_node: {ros__parameters: 3}"])
def test_a_run_whose_parameters_are_damaged_is_not(text: str, tmp_path: Path) -> None:
    store(tmp_path, {})
    (tmp_path / "hand_node.yaml").write_text(text)
    with pytest.raises(InvalidSettingsError, match="does not say how the trials"):
        check_continues(tmp_path, parameters_of(tmp_path))


def test_a_run_whose_log_is_gone_may_be_explored_by_another_method(tmp_path: Path) -> None:
    store(tmp_path, parameters_of(tmp_path))
    (tmp_path / "run.jsonl").unlink()
    check_continues(tmp_path, parameters_of(tmp_path, "--method", "mebo"))
