"""What README.md tells a user of ROS is what the running nodes have: names, types, and calls that work."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet
from std_srvs.srv import Trigger

from .harness import Probe, wait_until
from .scenes import OBJECT, Scene

pytestmark = pytest.mark.nodes

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
SERVICE_TYPES = {"GetBestGrasp": GetBestGrasp, "GetSolutionSet": GetSolutionSet, "Trigger": Trigger}


def table(title: str) -> list[list[str]]:
    """Return the cells of the table below a heading, without its first two lines."""
    section = README.split(f"### {title}\n", 1)[1].split("\n### ", 1)[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def names_in(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message as ``ros2 service call`` does from YAML."""
    for name, value in values.items():
        current = getattr(message, name)
        kind = message.get_fields_and_field_types()[name]
        if isinstance(value, dict):
            fill(current, value)
        elif isinstance(value, list) and kind.startswith("sequence<mebo_grasp_interfaces/Occlusion"):
            from mebo_grasp_interfaces.msg import Occlusion

            setattr(message, name, [fill(Occlusion(), entry) for entry in value])
        else:
            setattr(message, name, value)
    return message


@pytest.fixture
def scene(launch, probe: Probe, tmp_path: Path) -> Scene:
    scene = Scene(launch, probe, tmp_path, budget=25)
    scene.start()
    scene.wait_until_finished()
    wait_until(lambda: scene.stored() == 25)
    return scene


@pytest.mark.usefixtures("scene")
def test_topics_services_and_calls(launch, probe: Probe) -> None:
    # In the scene's space no candidate has a posture of its own; this hand expects one.
    launch("hand_node", object=OBJECT, expects_posture=True)
    wait_until(lambda: "/candidate_posture" in dict(probe.node.get_topic_names_and_types()))
    topics = dict(probe.node.get_topic_names_and_types())
    for topic_cell, type_cell, *_ in table("Topics"):
        topic_names = [name for name in names_in(topic_cell) if "<" not in name]
        types = names_in(type_cell)
        types = types if len(types) == len(topic_names) else types * len(topic_names)
        for name, kind in zip(topic_names, types, strict=True):
            assert kind in topics.get(f"/{name.lstrip('/')}", []), f"{name} should be a {kind}"

    services = dict(probe.node.get_service_names_and_types())
    for service_cell, type_cell, _ in table("Services"):
        first, *others = names_in(service_cell)
        folder = first.rsplit("/", 1)[0] if "/" in first else ""
        for name in [first, *(f"{folder}/{other}" for other in others)]:
            assert names_in(type_cell)[0] in services.get(f"/{name.lstrip('/')}", []), name

    calls = re.findall(r'ros2 service call (\S+) (\S+)(?: "(.*?)")?$', README, flags=re.MULTILINE | re.DOTALL)
    assert len(calls) == 3
    for name, kind, request in calls:
        service_type = SERVICE_TYPES[kind.rsplit("/", 1)[1]]
        reply = probe.call(service_type, name, fill(service_type.Request(), yaml.safe_load(request or "{}")))
        assert getattr(reply, "error_code", 0) in (0, 2), reply
    echoed = re.findall(r"ros2 topic echo (\S+)", README)
    assert len(echoed) == 3
    assert set(echoed) <= set(topics)


def test_executables_and_parameter_files_of_the_readme_exist() -> None:
    root = Path(__file__).parents[2]
    setup = (root / "setup.py").read_text(encoding="utf-8")
    runs = re.findall(r"ros2 run mebo_grasp (\w+) --ros-args --params-file src/mebo_grasp/(\S+) &", README)
    assert len(runs) == 3
    for executable, parameters in runs:
        assert f'"{executable} = mebo_grasp.nodes.executables:{executable}"' in setup
        assert (root / parameters).is_file()


def test_links_of_the_readme_lead_somewhere() -> None:
    root = Path(__file__).parents[2]
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (root / link).exists()] == []
