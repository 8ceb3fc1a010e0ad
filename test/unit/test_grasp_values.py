"""The shared value types: poses compose and invert, and what makes no sense is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mebo_grasp.errors import InvalidPoseError, InvalidQualityError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose, QualityUnderNoise

COORDINATES = st.floats(-10.0, 10.0, allow_nan=False)


@st.composite
def poses(draw) -> Pose:
    quaternion = draw(arrays(np.float64, 4, elements=st.floats(-1.0, 1.0)))
    norm = np.linalg.norm(quaternion)
    assume(norm > 0.1)
    return Pose(draw(arrays(np.float64, 3, elements=COORDINATES)), quaternion / norm)


@given(poses(), poses())
def test_composition_is_the_product_of_the_matrices(a: Pose, b: Pose) -> None:
    np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-9)


@given(poses())
def test_a_pose_and_its_inverse_cancel(pose: Pose) -> None:
    np.testing.assert_allclose((pose @ pose.inverse()).matrix, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(pose.inverse().matrix, np.linalg.inv(pose.matrix), atol=1e-9)


@given(poses(), arrays(np.float64, (5, 3), elements=COORDINATES))
def test_points_move_as_by_the_matrix(pose: Pose, points: np.ndarray) -> None:
    homogeneous = np.column_stack([points, np.ones(len(points))])
    np.testing.assert_allclose(pose.transform_points(points), (homogeneous @ pose.matrix.T)[:, :3], atol=1e-9)


@given(poses())
def test_matrix_round_trip(pose: Pose) -> None:
    np.testing.assert_allclose(Pose.from_matrix(pose.matrix).matrix, pose.matrix, atol=1e-9)


def test_roll_pitch_yaw_turn_about_fixed_axes() -> None:
    roll, pitch, yaw = 0.3, -0.4, 0.5
    Rx = [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
    Ry = [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
    Rz = [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    pose = Pose.from_rpy([1.0, 2.0, 3.0], [roll, pitch, yaw])
    np.testing.assert_allclose(pose.matrix[:3, :3], np.array(Rz) @ np.array(Ry) @ np.array(Rx), atol=1e-12)
    np.testing.assert_allclose(pose.rpy, [roll, pitch, yaw], atol=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y_and_the_scalar_comes_last() -> None:
    pose = Pose(np.zeros(3), np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]))
    np.testing.assert_allclose(pose.transform_points([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-12)


def test_rounding_in_the_norm_is_mended_and_more_is_refused() -> None:
    mended = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0005]))
    assert np.linalg.norm(mended.quaternion_xyzw) == pytest.approx(1.0, abs=1e-15)
    with pytest.raises(InvalidPoseError, match=r"norm 1\.01"):
        Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.01]))
    with pytest.raises(InvalidPoseError, match="norm 0"):
        Pose(np.zeros(3), np.zeros(4))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused(bad: float) -> None:
    with pytest.raises(InvalidPoseError, match="finite"):
        Pose(np.array([0.0, bad, 0.0]))
    with pytest.raises(InvalidPoseError, match="finite"):
        Pose.from_rpy([0.0, 0.0, 0.0], [bad, 0.0, 0.0])
    with pytest.raises(InvalidPoseError, match="finite"):
        HandPosture(("joint",), (bad,))
    with pytest.raises(InvalidPoseError, match="finite"):
        GraspContact("tip", np.array([bad, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))


def test_wrong_shapes_and_reflections_are_refused() -> None:
    with pytest.raises(InvalidPoseError, match="shape"):
        Pose(np.zeros(2))
    with pytest.raises(InvalidPoseError, match="rotation"):
        Pose.from_matrix(np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InvalidPoseError, match="2 names and 1 positions"):
        HandPosture(("a", "b"), (1.0,))
    with pytest.raises(InvalidPoseError, match="unit length"):
        GraspContact("tip", np.zeros(3), np.array([0.0, 0.0, 2.0]))


def test_values_cannot_be_changed_from_outside() -> None:
    position = np.zeros(3)
    pose = Pose(position)
    position[0] = 9.0
    assert pose.position[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        pose.position[0] = 1.0


def test_quality_is_nan_exactly_when_the_trial_failed() -> None:
    failed = Grasp.failed(Pose.identity(), "the hand is away")
    assert failed.outcome is GraspOutcome.FAILED
    assert math.isnan(failed.quality)
    for outcome, quality in (
        (GraspOutcome.FAILED, 0.0),
        (GraspOutcome.GRASPED, math.nan),
        (GraspOutcome.GRASPED, math.inf),
    ):
        with pytest.raises(InvalidPoseError, match="contradicts"):
            Grasp(Pose.identity(), outcome, quality)


def test_contacts_built_together_are_those_built_one_by_one() -> None:
    points, normals = np.arange(6.0).reshape(2, 3), np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
    both = GraspContact.from_rows(("a", "b"), points, normals)
    for contact, link, point, normal in zip(both, "ab", points, normals, strict=True):
        single = GraspContact(link, point, normal)
        assert (contact.link, contact.position.tolist()) == (single.link, single.position.tolist())
        assert contact.normal.tolist() == single.normal.tolist()
        with pytest.raises(ValueError, match="read-only"):
            contact.position[0] = 1.0
    for bad in ([[0.0, 0.0, 1.1], [1.0, 0.0, 0.0]], [[0.0, 0.0, math.nan], [1.0, 0.0, 0.0]]):
        with pytest.raises(InvalidPoseError):
            GraspContact.from_rows(("a", "b"), points, bad)
    with pytest.raises(InvalidPoseError):
        GraspContact.from_rows(("a",), points, normals)


def test_repeated_executions_are_summed_up_and_failed_ones_left_out() -> None:
    known = QualityUnderNoise.of([0.2, 0.4, math.nan, 0.6])
    assert known is not None
    np.testing.assert_allclose((known.expected, known.sd, known.worst), (0.4, 0.2, 0.2))
    assert known.samples == 3
    assert QualityUnderNoise.of([0.3]) == QualityUnderNoise(0.3, 0.0, 0.3, 1)
    assert QualityUnderNoise.of([math.nan]) is None
    assert QualityUnderNoise.of([0.1] * 3) is not None  # their mean is below 0.1 by rounding, or above


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ((0.4, 0.1, 0.2, 0), "at least 1 sample, got 0"),
        ((math.nan, 0.1, 0.2, 3), "expected nan"),
        ((0.4, -0.1, 0.2, 3), "sd -0.1"),
        ((0.4, 0.1, math.inf, 3), "worst inf"),
        ((0.4, 0.1, 0.5, 3), "worst quality 0.5 cannot be above the expected one, 0.4"),
    ],
)
def test_figures_under_noise_that_cannot_be_are_refused(figures, words: str) -> None:
    with pytest.raises(InvalidQualityError, match=words):
        QualityUnderNoise(*figures)
