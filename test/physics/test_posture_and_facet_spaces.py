"""Spaces with a posture and spaces about a facet, down to whole trials."""

from __future__ import annotations

import numpy as np
import pytest

from mebo_grasp.errors import InvalidHandError, InvalidSettingsError
from mebo_grasp.grasp import GraspOutcome, Pose
from mebo_grasp.grasping.facet_space import FACETS, FacetSpace, facet_axes, facet_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d, side_approach_rpy
from mebo_grasp.grasping.posture_space import PosturePoseSpace, pose_posture_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

BOTTLE, DRILL = TargetObject.builtin("bottle"), TargetObject.builtin("drill")
LEFT, RIGHT = HandModel.load("icub_left"), HandModel.load("icub_right")


def uniform(space: FacetSpace | PosturePoseSpace, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(space.lower, space.upper, (count, space.dimension))


def test_a_posture_candidate_is_a_pose_and_a_posture() -> None:
    space = pose_posture_space(BOTTLE, LEFT)
    assert space.names == ("x", "y", "z", "roll", "pitch", "yaw", "synergy_1", "synergy_2")
    plain = pose_space_6d(BOTTLE, LEFT)
    for x in uniform(space, 10, 1):
        np.testing.assert_array_equal(space.to_pose(x).matrix, plain.to_pose(x[:6]).matrix)
        back = space.from_pose(space.to_pose(x), space.basis.posture(LEFT, x[6:] * 0.3))
        np.testing.assert_allclose(back, np.concatenate([x[:6], 0.3 * x[6:]]), atol=1e-5)
        assert space.contains(x)
    assert not space.contains(space.upper + 1.0)


def test_a_hand_closes_from_the_posture_it_is_given() -> None:
    """Joints only close further from there, and the next trial without a posture begins at the preshape again."""
    space = pose_posture_space(BOTTLE, LEFT)
    with GraspSimulator(BOTTLE, LEFT, TrialSettings(compute_volume=False)) as simulator:
        plain = [simulator.trial(space.to_pose(x)) for x in uniform(space, 40, 3)]
        grasps = [(x, simulator.trial(space.to_pose(x), space.to_posture(x))) for x in uniform(space, 40, 3)]
        again = [simulator.trial(space.to_pose(x)) for x in uniform(space, 40, 3)]
    for first, second in zip(plain, again, strict=True):
        assert first.outcome is second.outcome
        assert (first.epsilon, first.hand_posture) == (second.epsilon, second.hand_posture)
    assert {grasp.outcome for _, grasp in grasps} >= {GraspOutcome.GRASPED, GraspOutcome.COLLISION}
    differs = 0
    for (x, grasp), without in zip(grasps, plain, strict=True):
        start, end = space.to_posture(x), grasp.hand_posture
        assert np.all(np.array(end.positions) >= np.array(start.positions) - 1e-9)
        assert end.positions[0] == start.positions[0]  # opposition does not close
        differs += grasp.hand_posture != without.hand_posture
        if grasp.outcome is GraspOutcome.COLLISION:
            assert end == start
    assert differs > 30


def test_a_fresh_simulator_with_the_posture_gives_the_same_bits() -> None:
    space = pose_posture_space(BOTTLE, LEFT)
    points = uniform(space, 12, 9)
    with GraspSimulator(BOTTLE, LEFT) as simulator:
        once = [simulator.trial(space.to_pose(x), space.to_posture(x)) for x in points]
    for x, grasp in zip(points, once, strict=True):
        with GraspSimulator(BOTTLE, LEFT) as simulator:
            other = simulator.trial(space.to_pose(x), space.to_posture(x))
        assert (other.outcome, other.epsilon, other.hand_posture) == (grasp.outcome, grasp.epsilon, grasp.hand_posture)


def test_postures_beyond_limits_and_wrong_bounds_are_refused() -> None:
    with GraspSimulator(BOTTLE, LEFT) as simulator, pytest.raises(InvalidHandError, match="l_thumb_0"):
        simulator.trial(Pose.identity(), LEFT.posture({"l_thumb_0": 3.0}))
    with pytest.raises(InvalidSettingsError, match="8 bounds"):
        pose_posture_space(BOTTLE, LEFT, lower=np.zeros(6))
    with pytest.raises(InvalidSettingsError, match="rising"):
        pose_posture_space(BOTTLE, LEFT, lower=np.append(pose_space_6d(BOTTLE, LEFT).lower, [2.0, 2.0]))
    with pytest.raises(InvalidSettingsError, match="8 values"):
        pose_posture_space(BOTTLE, LEFT).to_posture(np.zeros(6))


@pytest.mark.parametrize("hand", [LEFT, RIGHT])
@pytest.mark.parametrize("facet", FACETS)
def test_the_default_pose_faces_the_facet_from_outside(facet: str, hand: HandModel) -> None:
    space = facet_space(DRILL, hand, facet=facet)
    normal, along = facet_axes(facet, None)
    pose = space.to_pose(np.zeros(6))
    R = pose.rotation.as_matrix()
    np.testing.assert_allclose(R @ hand.palm_normal, -normal, atol=1e-9)
    np.testing.assert_allclose(R[:, 0], along, atol=1e-9)
    low, high = DRILL.bounds
    on_facet = float(normal @ ((low + high) / 2.0) + np.abs(normal) @ ((high - low) / 2.0))
    assert normal @ pose.position > on_facet + 0.02
    # Towards the facet is against its normal; along is where the fingers point.
    moved = space.to_pose([0.01, 0.0, 0.02, 0.0, 0.0, 0.0]).position - pose.position
    np.testing.assert_allclose(moved, 0.01 * along - 0.02 * normal, atol=1e-12)
    for x in uniform(space, 10, 4):
        np.testing.assert_allclose(space.from_pose(space.to_pose(x)), x, atol=1e-9)


@pytest.mark.parametrize("hand", [LEFT, RIGHT])
def test_the_facet_of_y_is_the_side_approach(hand: HandModel) -> None:
    pose = facet_space(BOTTLE, hand, facet="+y").to_pose(np.zeros(6))
    expected = Pose.from_rpy(pose.position, side_approach_rpy(hand))
    np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-12)


@pytest.mark.parametrize("facet", FACETS)
def test_every_facet_of_the_drill_gives_grasps(facet: str) -> None:
    space = facet_space(DRILL, LEFT, facet=facet)
    with GraspSimulator(DRILL, LEFT, TrialSettings(compute_volume=False)) as simulator:
        outcomes = [simulator.trial(space.to_pose(x)).outcome for x in uniform(space, 60, 2)]
    assert outcomes.count(GraspOutcome.GRASPED) >= 5


def test_the_power_synergy_is_a_seventh_dimension() -> None:
    space = facet_space(BOTTLE, LEFT, synergy=True)
    assert space.names[-1] == "synergy_1"
    bent = [sum(space.to_posture([0, 0, 0, 0, 0, 0, a]).positions) for a in (-1.0, 0.0, 1.0)]
    assert bent == sorted(bent)
    assert bent[0] < bent[2]
    with GraspSimulator(BOTTLE, LEFT, TrialSettings(quality="simox_epsilon", compute_volume=False)) as simulator:
        good = [simulator.trial(space.to_pose(x), space.to_posture(x)).quality > 0.0 for x in uniform(space, 60, 2)]
    assert sum(good) >= 3
    assert facet_space(BOTTLE, LEFT).to_posture(np.zeros(6)) == LEFT.preshape


def test_facets_that_are_none_are_refused() -> None:
    with pytest.raises(InvalidSettingsError, match="top"):
        facet_space(BOTTLE, LEFT, facet="top")
    with pytest.raises(InvalidSettingsError, match="do not lie"):
        facet_space(BOTTLE, LEFT, facet="+z", fingers="-z")
    with pytest.raises(InvalidSettingsError, match="bounds of shapes"):
        facet_space(BOTTLE, LEFT, lower=np.zeros(3))
