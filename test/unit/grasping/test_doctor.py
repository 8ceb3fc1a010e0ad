"""The doctor finds what is wrong with hands and objects, and nothing where nothing is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from mebo_grasp.cli.doctor import examine
from mebo_grasp.cli.main import main
from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasping.doctor import Finding, Level, check_hand, check_object, check_together
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import finger_reach, position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject

GRIPPER_YAML = """
name: gripper
urdf: gripper.urdf
tcp: {link: palm}
palm_links: [palm]
palm_normal: [1, 0, 0]
grasp_center: [GRASP, 0, 0]
fingers:
  upper: {joints: [upper_joint], speeds: [UPPER]}
  lower: {joints: [lower_joint]}
"""


def gripper(folder: Path, unit: float = 1.0, upper_speed: float = -1.0) -> HandModel:
    """Write a gripper of two fingers whose lengths are metres times ``unit``, and load it."""

    def finger(name: str) -> str:
        return (
            f'<link name="{name}"><collision><origin xyz="{0.045 * unit} 0 0" rpy="0 1.5707963 0"/><geometry>'
            f'<cylinder radius="{0.008 * unit}" length="{0.09 * unit}"/></geometry></collision></link>'
        )

    def joint(name: str, y: float, lower: float, upper: float) -> str:
        return (
            f'<joint name="{name}_joint" type="revolute"><origin xyz="{-0.015 * unit} {y * unit} 0"/>'
            f'<parent link="palm"/><child link="{name}"/><axis xyz="0 0 1"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        )

    size = f"{0.02 * unit} {0.1 * unit} {0.04 * unit}"
    palm = f'<collision><origin xyz="{-0.03 * unit} 0 0"/><geometry><box size="{size}"/></geometry></collision>'
    text = f'<robot name="gripper"><link name="palm">{palm}</link>{finger("upper")}{finger("lower")}'
    text += joint("upper", 0.045, -0.8, 0.3) + joint("lower", -0.045, -0.3, 0.8) + "</robot>"
    (folder / "gripper.urdf").write_text(text)
    yaml = GRIPPER_YAML.replace("UPPER", str(upper_speed)).replace("GRASP", str(0.04 * unit))
    (folder / "gripper.yaml").write_text(yaml)
    return HandModel.load(folder / "gripper.yaml")


def worst(findings: list[Finding], topic: str) -> Finding:
    return max((finding for finding in findings if finding.topic == topic), key=lambda finding: finding.level)


@pytest.mark.parametrize("name", ["icub_left", "icub_right"])
def test_the_built_in_hands_are_sound(name: str) -> None:
    findings = check_hand(HandModel.load(name))
    assert all(finding.level is Level.OK for finding in findings)
    assert {finding.topic for finding in findings} == {"hand", "scale", "frames", "closing", "self-collision"}


def test_a_hand_in_millimetres_is_named_as_such(tmp_path: Path) -> None:
    assert worst(check_hand(gripper(tmp_path)), "scale").level is Level.OK
    found = worst(check_hand(gripper(tmp_path, unit=1000.0)), "scale")
    assert found.level is Level.ERROR
    assert "millimetres taken for metres" in found.text
    assert "scaled to metres twice" in worst(check_hand(gripper(tmp_path, unit=0.001)), "scale").text


def test_trials_with_a_hand_in_millimetres_are_refused_before_they_fill_the_memory(tmp_path: Path) -> None:
    with pytest.raises(InvalidHandError, match="millimetres"):
        GraspSimulator(TargetObject.builtin("bottle"), gripper(tmp_path, unit=1000.0))


def test_a_finger_that_opens_instead_of_closing_is_named(tmp_path: Path) -> None:
    assert worst(check_hand(gripper(tmp_path)), "closing").level is Level.OK
    found = worst(check_hand(gripper(tmp_path, upper_speed=1.0)), "closing")
    assert found.level is Level.ERROR
    assert "'upper'" in found.text


def test_a_palm_that_faces_elsewhere_than_the_search_spaces_expect_is_named(tmp_path: Path) -> None:
    assert worst(check_hand(gripper(tmp_path)), "frames").level is Level.WARNING


def test_a_gripper_of_one_joint_a_finger_has_a_search_space_about_a_box(tmp_path: Path) -> None:
    """Its fingers are 90 mm long; the spheres that cover them stick out by less than 3 mm."""
    hand, carton = gripper(tmp_path), TargetObject.from_mesh(trimesh.creation.box((0.1, 0.06, 0.2)), "carton")
    assert 0.090 < finger_reach(hand) < 0.0931
    space = position_space(carton, hand)
    assert space.upper[1] - space.lower[1] == pytest.approx(finger_reach(hand))
    assert check_together(hand, carton, trials=4)


def test_links_that_overlap_in_the_preshape_are_named() -> None:
    hand = HandModel.load("icub_left")
    bent = dict.fromkeys(("l_thumb_1", "l_thumb_2", "l_index_1", "l_index_2"), 1.2)
    description = replace(hand.description, preshape={**hand.description.preshape, **bent})
    found = worst(check_hand(HandModel(description, hand.urdf)), "self-collision")
    assert found.level is Level.WARNING
    assert "l_thumb" in found.text


def test_a_grasp_centre_far_from_the_hand_is_an_error() -> None:
    hand = HandModel.load("icub_left")
    description = replace(hand.description, grasp_center=(-2.5, -10.0, 9.0))
    assert worst(check_hand(HandModel(description, hand.urdf)), "frames").level is Level.ERROR


def test_the_built_in_objects_are_sound() -> None:
    for name in ("bottle", "vase", "glass"):
        findings = check_object(TargetObject.builtin(name))
        assert [finding.level for finding in findings] == [Level.OK] * len(findings)


def test_an_open_surface_is_named(tmp_path: Path) -> None:
    mesh = trimesh.creation.cylinder(0.03, 0.15)
    mesh.update_faces([i != 0 for i in range(len(mesh.faces))])
    mesh.export(tmp_path / "open.stl")
    found = worst(check_object(TargetObject.from_file(tmp_path / "open.stl")), "surface")
    assert found.level is Level.WARNING
    assert "3 open edges" in found.text


def test_a_hollow_closed_surface_is_exact_and_nothing_to_warn_of() -> None:
    found = worst(check_object(TargetObject.from_mesh(trimesh.creation.annulus(0.02, 0.04, 0.1), "ring")), "solid")
    assert found.level is Level.OK
    assert "98.5 %" in found.text


def test_a_hand_that_the_derived_space_does_not_fit_is_told_so(tmp_path: Path) -> None:
    (found,) = check_together(gripper(tmp_path), TargetObject.builtin("bottle"), 16)
    assert found.level is Level.ERROR
    assert "does not fit this hand's frame" in found.text


def test_an_object_far_from_its_origin_is_named() -> None:
    mesh = trimesh.creation.cylinder(0.03, 0.15)
    mesh.apply_translation([3.0, 0.0, 0.0])
    found = worst(check_object(TargetObject.from_mesh(mesh, "far")), "frames")
    assert found.level is Level.WARNING
    assert "2.97 m" in found.text


def test_a_hand_that_closes_on_nothing_is_an_error() -> None:
    hand = HandModel.load("icub_left")
    turned = replace(hand.description, palm_normal=(0.0, 0.0, 1.0))  # the derived poses now show the hand's back
    found = check_together(HandModel(turned, hand.urdf), TargetObject.builtin("bottle"), trials=16)
    assert found[0].level is Level.ERROR
    assert "touches nothing" in found[0].text or "collides everywhere" in found[0].text


def test_the_command_says_which_hand_is_used_and_ends_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    printed = capsys.readouterr().out
    assert "light hand, primitives only (2 box, 16 capsule)" in printed
    assert "in force closure" in printed
    assert "0 errors, 0 warnings" in printed


def test_the_command_names_millimetres_and_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trimesh.creation.cylinder(30.0, 150.0).export(tmp_path / "tin.stl")
    assert main(["doctor", "--object", str(tmp_path / "tin.stl")]) == 1
    assert "it looks like millimetres, use scale 0.001" in capsys.readouterr().out
    assert {finding.level for finding in examine("icub_left", str(tmp_path / "tin.stl"), 0.001)} == {Level.OK}
