"""Grasps as an objective: the thesis's boxes and occlusions, and the simulator behind it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.protocol import settings_of
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

PARAMS = Path(__file__).resolve().parents[3] / "params" / "thesis"
POSE = np.array([-0.03, 0.045, 0.005, -1.5, 0.1, 0.1])


@pytest.mark.parametrize("space", ["position", "pose"])
@pytest.mark.parametrize("name", ["bottle", "vase", "drill"])
def test_boxes_are_those_of_the_parameter_files(name: str, space: str) -> None:
    content = yaml.safe_load((PARAMS / f"{name}_{space}.yaml").read_text())
    node = content["optimizer_node"]["ros__parameters"]
    with GraspObjective(name, space, bounds="thesis").open(0) as evaluator:
        np.testing.assert_allclose(evaluator.space.lower, node["lower_bounds"], atol=1e-9)
        np.testing.assert_allclose(evaluator.space.upper, node["upper_bounds"], atol=1e-9)


def test_values_are_those_of_the_simulator_at_the_same_pose() -> None:
    target, hand = TargetObject.builtin("bottle"), HandModel.load("icub_left")
    pose = pose_space_6d(target, hand).to_pose(POSE)
    with GraspSimulator(target, hand, TrialSettings(friction=0.4, compute_volume=False)) as simulator:
        grasp = simulator.trial(pose)
    assert grasp.quality > 0.0
    objective = GraspObjective("bottle", "pose", friction=0.4)
    with objective.open(0) as evaluator:
        assert evaluator(POSE[None])[0] == grasp.quality
    _, _, again = objective.grasps(POSE[None])
    assert again[0].quality == grasp.quality
    assert len(again[0].contacts) == len(grasp.contacts) > 0


@pytest.mark.parametrize(
    ("name", "height", "small", "large"),
    [
        # Heights of the TCP in the thesis's scene, mm; what is blocked there is not available.
        ("bottle", -91.0, True, True), ("bottle", -89.0, False, False), ("bottle", 29.0, False, False),
        ("bottle", 31.0, True, False), ("vase", -36.0, True, True), ("vase", 64.0, False, False),
        ("vase", 66.0, True, False), ("drill", -51.0, True, True), ("drill", 51.0, True, False),
    ],
)  # fmt: skip
def test_occlusions_block_the_thesiss_heights(name: str, height: float, small: bool, large: bool) -> None:
    # From the scene's height to the built-in object's: by how much the lower ends of the same box differ.
    shift = {"bottle": -109.76 - -150.0, "vase": -113.2 - -70.0, "drill": -120.0 - -70.0}[name]
    free = GraspObjective(name, bounds="thesis").available(np.array([[0.0, 0.0, (height + shift) / 1000.0]]))
    assert (bool(free["small"][0]), bool(free["large"][0])) == (small, large)


def test_a_mesh_that_stands_for_an_object_lies_where_that_object_lay(tmp_path: Path) -> None:
    # The bottle's box with its origin at the upper end, as in the thesis's own mesh.
    mesh = trimesh.creation.box((0.06566, 0.06566, 0.19952))
    mesh.apply_translation((0.0, 0.0, -0.1))
    path = tmp_path / "own.stl"
    mesh.export(path)
    moved = GraspObjective(str(path), bounds="thesis", scene="bottle")
    plain = GraspObjective("bottle", bounds="thesis")
    with moved.open(0) as a, plain.open(0) as b:
        np.testing.assert_allclose(a.space.lower[2], b.space.lower[2] - 0.1, atol=1e-9)
    X = np.array([[0.0, 0.0, z] for z in np.linspace(-0.12, 0.08, 41)])
    for name, free in plain.available(X).items():
        np.testing.assert_array_equal(moved.available(X - [0.0, 0.0, 0.1])[name], free)


def test_only_the_thesiss_objects_have_occlusions() -> None:
    assert GraspObjective("mug").available(np.zeros((1, 3))) == {}


def test_every_method_is_told_the_wanted_set() -> None:
    for method in ("mebo", "robot"):
        settings = settings_of(Job(method, GraspObjective("drill", bounds="thesis"), 0))[1]
        assert (settings.num_solutions, settings.min_distance) == (3, 0.04)


def test_a_radian_counts_a_millimetre_in_distances_unless_told() -> None:
    with GraspObjective("bottle", "pose").open(0) as evaluator:
        np.testing.assert_allclose(evaluator.space.distance_weights, [1.0] * 3 + [0.001] * 3)
    with GraspObjective("bottle", "pose", rotation_weight=0.05).open(0) as evaluator:
        assert evaluator.space.distance_weights[3] == 0.05


def test_files_of_packages_are_found_and_absent_packages_named() -> None:
    objective = GraspObjective("pybullet_data:random_urdfs/025/025.obj", scale=0.015)
    assert objective.column == "025"
    with objective.open(0) as evaluator:
        assert evaluator.space.dim == 3
    absent = GraspObjective("no_such_package:a.stl")
    with pytest.raises(InvalidObjectError, match="no_such_package is not installed"), absent.open(0):
        pass
