"""The capsules of a hand hold all of it, stand where its links stand, and stick out by no more than promised."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import Grasp, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HAND_NAMES, HANDS_FOLDER, HandModel
from mebo_grasp.grasping.rendering import shape_mesh
from mebo_grasp.grasping.urdf import LinkShape
from mebo_grasp.hand_volumes import STRIP, HandVolumes, VolumeOfHand, capsules_of
from mebo_grasp.solutions.hand_volume import HandVolume


def depth(volume: HandVolume, points: np.ndarray) -> np.ndarray:
    """Distance of points to the union of the capsules, negative inside: straight from the definition."""
    along = volume.ends - volume.starts
    offsets = points[:, None] - volume.starts[None]
    squared = np.maximum((along**2).sum(axis=1), 1e-30)
    t = np.clip((offsets * along).sum(axis=2) / squared, 0.0, 1.0)
    return (np.linalg.norm(offsets - t[..., None] * along, axis=2) - volume.radii).min(axis=1)


def random_posture(hand: HandModel, rng: np.random.Generator) -> HandPosture:
    return HandPosture(hand.joint_names, tuple(rng.uniform(hand.lower, hand.upper)))


@pytest.mark.parametrize("name", HAND_NAMES)
def test_the_capsules_hold_every_collision_shape_in_any_posture(name: str) -> None:
    hand, rng = HandModel.load(name), np.random.default_rng(1)
    volume_of = VolumeOfHand(hand)
    for _ in range(5):
        posture = random_posture(hand, rng)
        volume = volume_of(posture)
        for shape in hand.link_geometry(posture, collision=True):
            mesh = shape_mesh(shape)
            surface = shape.T_tcp_shape.transform_points(np.array(mesh.vertices))
            assert depth(volume, surface).max() < 1e-6, shape.link


def test_boxes_are_covered_and_little_more() -> None:
    sides = (0.044, 0.06, 0.027)
    starts, ends, radii = capsules_of(LinkShape("palm", "box", sides, np.eye(4)))
    volume = HandVolume(starts, ends, radii)
    box = trimesh.creation.box(sides)
    rng = np.random.default_rng(2)
    inside = rng.uniform(-0.5, 0.5, (5000, 3)) * sides
    assert depth(volume, np.vstack([inside, box.vertices])).max() < 1e-9
    reach = np.max(np.abs(np.vstack([starts, ends])) + radii[0], axis=0) - np.array(sides) / 2
    assert np.all(reach <= np.array([0.5, 0.75, 0.5]) * STRIP)


def test_a_cylinder_a_sphere_and_a_mesh_are_covered() -> None:
    turned = Pose.from_rpy([0.01, 0.02, 0.03], [0.4, 0.5, 0.6]).matrix
    cube = trimesh.creation.box((0.02, 0.03, 0.08))
    shapes = [
        (LinkShape("a", "cylinder", (0.01, 0.05), turned), trimesh.creation.cylinder(0.01, 0.05)),
        (LinkShape("a", "sphere", (0.01,), turned), trimesh.creation.icosphere(3, 0.01)),
        (LinkShape("a", "mesh", (), turned, np.array(cube.vertices)), cube),
    ]
    for shape, mesh in shapes:
        points = np.array(mesh.vertices) @ turned[:3, :3].T + turned[:3, 3]
        assert depth(HandVolume(*capsules_of(shape)), points).max() < 1e-9, shape.kind


def grasp_of(hand: str, posture: HandPosture) -> Grasp:
    return Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, hand=hand, hand_posture=posture)


def test_each_grasp_has_the_volume_of_its_own_hand() -> None:
    left, right = HandModel.load("icub_left"), HandModel.load("icub_right")
    volumes = HandVolumes([left])
    for hand in (left, right):
        posture = random_posture(hand, np.random.default_rng(3))
        found = volumes(grasp_of(hand.name, posture))
        np.testing.assert_allclose(found.starts, VolumeOfHand(hand)(posture).starts)


def test_an_unknown_hand_is_told_once_and_the_first_stands_in() -> None:
    left = HandModel.load("icub_left")
    told: list[str] = []
    volumes = HandVolumes([left], told.append)
    for _ in range(2):
        found = volumes(grasp_of("claw", HandPosture(("pincer",), (math.pi,))))
        np.testing.assert_allclose(found.ends, VolumeOfHand(left)(left.preshape).ends)
    assert told == ["claw"]


def test_a_hand_too_large_for_a_volume_is_refused_at_once(tmp_path: Path) -> None:
    text = (HANDS_FOLDER / "icub_left.urdf").read_text()
    (tmp_path / "icub_left.urdf").write_text(re.sub(r'size="[^"]*"', 'size="1.4 0.02 0.02"', text, count=2))
    data = yaml.safe_load((HANDS_FOLDER / "icub_left.yaml").read_text())
    (tmp_path / "long.yaml").write_text(yaml.safe_dump(data | {"name": "long"}))
    with pytest.raises(InvalidHandError, match=r"'long' has no volume: .* within 0\.655 m of the TCP, got one at 0\.7"):
        HandVolumes([HandModel.load(tmp_path / "long.yaml")])
