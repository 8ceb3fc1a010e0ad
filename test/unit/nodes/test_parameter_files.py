"""The files under ``params/`` show every parameter with the default that the nodes really have."""

import dataclasses
import re
from pathlib import Path

import pytest
import yaml

from mebo_grasp.nodes.settings import HandNodeSettings, OptimizerNodeSettings, SolutionSetNodeSettings

PARAMS = Path(__file__).parents[3] / "params"
NODES = {
    "hand_node": HandNodeSettings,
    "optimizer_node": OptimizerNodeSettings,
    "solution_set_node": SolutionSetNodeSettings,
}


@pytest.mark.parametrize("node", NODES)
def test_the_file_has_the_defaults_of_the_node(node: str) -> None:
    text = (PARAMS / f"{node}.yaml").read_text(encoding="utf-8")
    # ROS refuses an empty list, so a parameter that defaults to one is shown in a comment.
    text = re.sub(r"^    # (\w+: \[\])", r"    \1", text, flags=re.MULTILINE)
    shown = yaml.safe_load(text)[node]["ros__parameters"]
    fields = dataclasses.fields(NODES[node])
    defaults = {field.name: field.default for field in fields}
    assert {name: tuple(v) if isinstance(v, list) else v for name, v in shown.items()} == defaults


@pytest.mark.parametrize("node", NODES)
def test_each_parameter_is_explained_on_its_line(node: str) -> None:
    lines = (PARAMS / f"{node}.yaml").read_text(encoding="utf-8").splitlines()
    for field in dataclasses.fields(NODES[node]):
        (line,) = [line for line in lines if re.match(rf"\s+(# )?{field.name}:", line)]
        assert field.metadata["description"] in line
