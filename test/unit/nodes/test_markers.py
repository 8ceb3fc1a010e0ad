"""What RViz is shown stands where the hand and the occlusions are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HANDS_FOLDER, HandModel
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes import markers
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Sphere

HAND = HandModel.load("icub_left")
CONTACT = GraspContact("tip", np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0]))


def grasp(hand: str = HAND.name, y: float = 0.5) -> Grasp:
    pose = Pose.from_rpy([0.0, y, 0.0], [0.0, 0.0, 0.0])
    return Grasp(pose, GraspOutcome.GRASPED, 0.1, contacts=(CONTACT,), hand=hand)


def position_of(marker: Marker) -> np.ndarray:
    return np.array([marker.pose.position.x, marker.pose.position.y, marker.pose.position.z])


def test_old_markers_go_first_and_every_id_is_used_once() -> None:
    array = markers.grasp_markers([grasp(), grasp(y=0.6)], "bottle")
    assert array.markers[0].action == Marker.DELETEALL
    names = [(marker.ns, marker.id) for marker in array.markers[1:]]
    assert len(set(names)) == len(names)
    assert {marker.header.frame_id for marker in array.markers} == {"bottle"}


def test_hands_move_with_the_grasp_and_contacts_stay_on_the_object() -> None:
    here, there = (markers.grasp_markers([grasp(y=y)], "bottle").markers[1:] for y in (0.5, 0.7))
    for a, b in zip(here, there, strict=True):
        shift = [0.0, 0.2, 0.0] if a.ns.startswith("hand") and a.type != Marker.SPHERE_LIST else [0.0, 0.0, 0.0]
        np.testing.assert_allclose(position_of(b) - position_of(a), shift, atol=1e-12)
    (arrow,) = [marker for marker in here if marker.type == Marker.ARROW]
    tip = arrow.points[-1]
    assert (tip.x, tip.y, tip.z) == (0.1, 0.2, 0.3)


def test_a_hand_that_is_unknown_here_is_an_arrow_at_its_tcp() -> None:
    hand_marker = markers.grasp_markers([grasp(hand="a hand from elsewhere")], "bottle").markers[1]
    assert hand_marker.type == Marker.ARROW
    np.testing.assert_allclose(position_of(hand_marker), [0.0, 0.5, 0.0])


@pytest.mark.parametrize(
    ("shape", "scale"),
    [
        (Box((0.1, 0.2, 0.3)), (0.1, 0.2, 0.3)),
        (Sphere(0.1), (0.2, 0.2, 0.2)),
        (Cylinder(0.3, 0.1), (0.2, 0.2, 0.3)),
    ],
)
def test_occlusions_have_their_size_and_place(shape, scale) -> None:
    occlusion = Occlusion("shelf", shape, Pose(np.array([1.0, 2.0, 3.0])))
    marker = markers.solution_markers([], [occlusion], "bottle").markers[-1]
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == scale
    np.testing.assert_allclose(position_of(marker), [1.0, 2.0, 3.0])


def test_a_cone_stands_about_its_middle_with_the_apex_up() -> None:
    occlusion = Occlusion("cone", Cone(0.4, 0.1), Pose.identity())
    points = markers.solution_markers([], [occlusion], "bottle").markers[-1].points
    heights = np.array([[point.x, point.y, point.z] for point in points])
    assert heights[:, 2].min() == pytest.approx(-0.2)
    apex = heights[np.argmax(heights[:, 2])]
    np.testing.assert_allclose(apex, [0.0, 0.0, 0.2], atol=1e-12)


def test_the_object_is_its_mesh() -> None:
    target = TargetObject.builtin("bottle")
    marker = markers.object_markers(target).markers[-1]
    corners = np.array([[point.x, point.y, point.z] for point in marker.points])
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], target.bounds, atol=1e-12)


def test_a_hand_of_ones_own_is_drawn_where_it_is_given(tmp_path: Path) -> None:
    mine = replace(HAND, description=replace(HAND.description, name="mine"))
    (known, *_) = markers.grasp_markers([grasp(hand="mine")], "bottle", mine).markers[1:]
    assert known.type != Marker.ARROW
    (other, *_) = markers.grasp_markers([grasp(hand="another")], "bottle", mine).markers[1:]
    assert other.type == Marker.ARROW
    # A name comes from a message: it must not lead to a file.
    path = tmp_path / "icub_left.yaml"
    path.write_text((HANDS_FOLDER / "icub_left.yaml").read_text())
    (tmp_path / "icub_left.urdf").write_text((HANDS_FOLDER / "icub_left.urdf").read_text())
    (file, *_) = markers.grasp_markers([grasp(hand=str(path))], "bottle").markers[1:]
    assert file.type == Marker.ARROW


def test_a_posture_that_is_not_the_hands_own_leaves_the_others_their_markers() -> None:
    odd = replace(grasp(), hand_posture=HandPosture(("tail_joint",), (0.1,)))
    drawn = {marker.ns for marker in markers.grasp_markers([odd, grasp()], "bottle").markers}
    assert {"hand 1", "hand 2"} <= drawn
