"""Search spaces: candidates and poses map to each other, and the bounds derived hold sensible approaches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mebo_grasp.errors import InvalidPoseError, InvalidSettingsError
from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.hand_model import HAND_NAMES, HandModel
from mebo_grasp.grasping.pose_space import (
    PoseSpace,
    distance_weights,
    finger_length,
    finger_reach,
    pose_space_6d,
    position_space,
)
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, TargetObject

HANDS = {name: HandModel.load(name) for name in HAND_NAMES}
LEFT = HANDS["icub_left"]
OBJECTS = {name: TargetObject.builtin(name) for name in BUILTIN_OBJECTS}
BOTTLE = OBJECTS["bottle"]
SPACE_3D = position_space(BOTTLE, LEFT)
SPACES_6D = {name: pose_space_6d(BOTTLE, hand) for name, hand in HANDS.items()}


def shares(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(0.0, 1.0), min_size=count, max_size=count)


def inside(space: PoseSpace, parts: list[float]) -> np.ndarray:
    return space.lower + np.array(parts) * (space.upper - space.lower)


def rotation_apart(one: Pose, other: Pose) -> float:
    return float((one.rotation.inv() * other.rotation).magnitude())


@given(parts=shares(3))
def test_positions_go_to_poses_and_back(parts: list[float]) -> None:
    x = inside(SPACE_3D, parts)
    pose = SPACE_3D.to_pose(x)
    np.testing.assert_array_equal(pose.position, x)
    np.testing.assert_array_equal(SPACE_3D.from_pose(pose), x)
    assert SPACE_3D.contains(x)


@pytest.mark.parametrize("name", HAND_NAMES)
@settings(deadline=None)
@given(parts=shares(6))
def test_six_numbers_go_to_poses_and_back(name: str, parts: list[float]) -> None:
    space = SPACES_6D[name]
    x = inside(space, parts)
    np.testing.assert_allclose(space.from_pose(space.to_pose(x)), x, atol=1e-7)
    assert space.contains(space.from_pose(space.to_pose(x)), 1e-6)


@settings(deadline=None)
@given(parts=shares(6), turns=st.lists(st.integers(-3, 3), min_size=3, max_size=3))
def test_angles_a_whole_turn_away_are_the_same_candidate(parts: list[float], turns: list[int]) -> None:
    space = SPACES_6D["icub_left"]
    x = inside(space, parts)
    far = x + np.concatenate([np.zeros(3), 2.0 * np.pi * np.array(turns)])
    np.testing.assert_allclose(space.from_pose(space.to_pose(far)), x, atol=1e-6)


@settings(deadline=None)
@given(quaternion=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_any_rotation_survives_the_way_through_a_candidate(quaternion: list[float]) -> None:
    space = SPACES_6D["icub_right"]
    pose = Pose(np.array([0.1, 0.2, 0.3]), np.array(quaternion) / np.linalg.norm(quaternion))
    x = space.from_pose(pose)
    assert rotation_apart(space.to_pose(x), pose) < 1e-6
    np.testing.assert_array_equal(x[:3], pose.position)


def test_a_range_beyond_half_a_turn_keeps_its_own_angles() -> None:
    """Yaw from 150 to 250 degrees: a pose at 200 must not come back as -160."""
    middle = np.radians([-90.0, 0.0, 200.0])
    low, high = np.array([-0.2, -0.2, -0.2, *(middle - 0.8)]), np.array([0.2, 0.2, 0.2, *(middle + 0.8)])
    space = pose_space_6d(BOTTLE, LEFT, low, high)
    x = np.array([0.0, 0.0, 0.0, *middle])
    np.testing.assert_allclose(space.from_pose(space.to_pose(x)), x, atol=1e-9)


def test_the_fixed_orientation_is_the_side_approach_of_the_thesis() -> None:
    """The left hand's roll is -90 degrees: its x axis along +x, its palm (-z of the hand) towards -y."""
    R = SPACE_3D.to_pose(np.zeros(3)).rotation.as_matrix()
    np.testing.assert_allclose(R, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)


@pytest.mark.parametrize("name", HAND_NAMES)
@pytest.mark.parametrize("thing", BUILTIN_OBJECTS)
def test_palms_in_the_derived_bounds_face_the_object(name: str, thing: str) -> None:
    target, hand = OBJECTS[thing], HANDS[name]
    for space in (position_space(target, hand), pose_space_6d(target, hand)):
        pose = space.to_pose((space.lower + space.upper) / 2.0)
        palm = pose.rotation.apply(hand.palm_normal)
        np.testing.assert_allclose(palm, [0.0, -1.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(pose.rotation.apply([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0], atol=1e-9)
        middle = target.bounds.mean(axis=0)
        assert (middle - pose.position) @ palm > 0.0
        assert np.all(space.lower < space.upper)


@pytest.mark.parametrize("name", HAND_NAMES)
@settings(deadline=None, max_examples=50)
@given(parts=shares(6))
def test_palms_anywhere_in_the_six_dimensions_look_towards_the_object(name: str, parts: list[float]) -> None:
    space = SPACES_6D[name]
    palm = space.to_pose(inside(space, parts)).rotation.apply(HANDS[name].palm_normal)
    assert palm @ [0.0, -1.0, 0.0] > 0.5


@pytest.mark.parametrize("thing", BUILTIN_OBJECTS)
def test_the_bounds_span_the_height_and_reach_past_the_surface(thing: str) -> None:
    target = OBJECTS[thing]
    space = position_space(target, LEFT)
    np.testing.assert_allclose([space.lower[2], space.upper[2]], target.bounds[:, 2])
    assert space.upper[1] == pytest.approx(target.bounds[1, 1] + finger_reach(LEFT))
    assert 0.0 < space.lower[1] <= target.bounds[1, 1] + 1e-9
    # The fingers reach the middle of the object from the side bound of the search.
    assert space.lower[0] < target.bounds[:, 0].mean() < space.lower[0] + finger_length(LEFT) + 0.1


def test_the_bounds_on_the_bottle_are_near_those_of_the_thesis() -> None:
    """In its scene the search is x -50..3, y -20..35 and the middle of the bottle's box stands at (25.57, -46) mm."""
    middle = np.array([25.57, -46.0])
    np.testing.assert_allclose(SPACE_3D.lower[:2], (np.array([-50.0, -20.0]) - middle) / 1e3, atol=0.005)
    np.testing.assert_allclose(SPACE_3D.upper[:2], (np.array([3.0, 35.0]) - middle) / 1e3, atol=0.005)


def test_both_hands_search_the_same_box() -> None:
    left, right = (position_space(BOTTLE, hand) for hand in HANDS.values())
    np.testing.assert_allclose(left.lower, right.lower, atol=1e-9)
    np.testing.assert_allclose(left.upper, right.upper, atol=1e-9)


def test_finger_reach_is_the_sum_of_the_bars_of_the_longest_finger() -> None:
    """From joint 1 on: 25.8 + 24.0 mm (middle), 25.9 + 22.0 mm (index and ring), 26 + 22 mm (thumb)."""
    assert finger_reach(LEFT) == pytest.approx(0.0258 + 0.0240, abs=1e-4)


def test_finger_length_is_that_of_the_farthest_capsule() -> None:
    farthest = 0.0
    for shape in LEFT.link_geometry(LEFT.preshape, collision=True):
        if shape.kind == "capsule":
            radius, length = shape.dims
            ends = shape.T_tcp_shape.transform_points([[0, 0, -length / 2], [0, 0, length / 2]])
            farthest = max(farthest, float(ends[:, 0].max()) + radius)
    # The spheres that cover a capsule stand out of it a little, never in.
    assert farthest - 1e-9 <= finger_length(LEFT) <= farthest + 0.0005


def test_bounds_given_replace_those_derived() -> None:
    low, high = [-0.1, 0.0, -0.2], [0.1, 0.3, 0.2]
    space = position_space(BOTTLE, LEFT, low, high)
    np.testing.assert_array_equal(space.lower, low)
    np.testing.assert_array_equal(space.upper, high)
    half = position_space(BOTTLE, LEFT, lower=[-0.1, 0.0, -0.2])
    np.testing.assert_array_equal(half.upper, SPACE_3D.upper)


def test_bounds_are_copied() -> None:
    low = np.array([-0.1, 0.0, -0.2])
    space = position_space(BOTTLE, LEFT, lower=low)
    low[0] = 9.0
    assert space.lower[0] == -0.1


@pytest.mark.parametrize(
    ("lower", "upper", "reason"),
    [
        ([0.1, 0.0, -0.2], [-0.1, 0.3, 0.2], "'x'.*rising"),
        ([-0.1, 0.3, -0.2], [0.1, 0.3, 0.2], "'y'.*rising"),
        ([-0.1, 0.0, np.nan], [0.1, 0.3, 0.2], "'z'.*finite"),
        ([-0.1, 0.0, -0.2], [0.1, np.inf, 0.2], "'y'.*finite"),
        ([-0.1, 0.0], [0.1, 0.3], "3"),
        ([-0.1, 0.0, -0.2, 0.0], [0.1, 0.3, 0.2, 1.0], "3"),
        (0.0, 1.0, "3"),
    ],
)
def test_bad_bounds_are_refused(lower: list[float], upper: list[float], reason: str) -> None:
    with pytest.raises(InvalidSettingsError, match=reason):
        position_space(BOTTLE, LEFT, lower, upper)


@pytest.mark.parametrize("names", [("x", "x"), ("x", "height")])
def test_names_that_mean_nothing_or_twice_the_same_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(InvalidSettingsError, match=names[1]):
        PoseSpace(names, ("m", "m"), np.zeros(2), np.ones(2), np.zeros(3), np.zeros(3))


def test_candidates_of_a_wrong_kind_are_refused() -> None:
    for wrong in ([0.0, 0.0], [0.0] * 6, 0.0, [[0.0, 0.0, 0.0]]):
        with pytest.raises(InvalidSettingsError, match="3 values"):
            SPACE_3D.to_pose(wrong)
    with pytest.raises(InvalidPoseError, match="finite"):
        SPACE_3D.to_pose([0.0, np.nan, 0.0])


def test_a_candidate_outside_or_not_finite_is_not_contained() -> None:
    middle = (SPACE_3D.lower + SPACE_3D.upper) / 2.0
    assert SPACE_3D.contains(middle)
    for bad in (SPACE_3D.upper + 0.01, SPACE_3D.lower - 0.01, middle * np.nan):
        assert not SPACE_3D.contains(bad)


def test_radians_are_weighed_and_postures_do_not_count() -> None:
    assert distance_weights(("m", "rad", "sd"), 0.05).tolist() == [1.0, 0.05, 0.0]
