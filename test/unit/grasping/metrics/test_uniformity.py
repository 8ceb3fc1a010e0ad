"""Q_UOT: the hand Jacobian against finite differences, the ratio by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mebo_grasp.grasp import GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.metrics.contact_models import grasp_matrix, singular_ratio
from mebo_grasp.grasping.metrics.uniformity import hand_jacobian, hand_object_jacobian, uniformity
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject

HAND = HandModel.load("icub_left")
BOTTLE = TargetObject.builtin("bottle")
STEP = 1e-6


def a_grasp() -> tuple[Pose, HandPosture, tuple[GraspContact, ...]]:
    space = position_space(BOTTLE, HAND)
    rng = np.random.default_rng(4)
    with GraspSimulator(BOTTLE, HAND) as simulator:
        for _ in range(100):
            grasp = simulator.trial(space.to_pose(rng.uniform(space.lower, space.upper)))
            if grasp.outcome is GraspOutcome.GRASPED and len(grasp.contacts) >= 5:
                return grasp.T_object_tcp, grasp.hand_posture, grasp.contacts
    raise AssertionError("no grasp with five contacts among 100")


def test_the_hand_jacobian_is_that_of_finite_differences() -> None:
    pose, posture, contacts = a_grasp()
    J = hand_jacobian(HAND, posture, pose, contacts)
    closing = [name for finger in HAND.fingers for name in finger.joints]
    values = dict(zip(posture.names, posture.positions, strict=True))
    T = pose.matrix
    for column, name in enumerate(closing):
        moved = []
        for sign in (-1.0, 1.0):
            frames = HAND.link_transforms(HAND.posture(values | {name: values[name] + sign * STEP}))
            start = HAND.link_transforms(posture)
            points = []
            for contact in contacts:
                local = np.linalg.inv(T @ start[contact.link]) @ np.append(contact.position, 1.0)
                points.append((T @ frames[contact.link] @ local)[:3])
            moved.append(np.array(points))
        np.testing.assert_allclose(J[:, :, column], (moved[1] - moved[0]) / (2.0 * STEP), atol=1e-8)
    assert np.count_nonzero(np.abs(J).max(axis=(1))) >= len(contacts)


def test_with_joints_that_move_each_contact_freely_uniformity_is_isotropy() -> None:
    """J_h = identity makes H the pseudo-inverse of G', whose singular values are those of G turned upside down."""
    angles = 2.0 * np.pi * np.arange(3) / 3
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    G = grasp_matrix("hard", 0.05 * outward, -outward, np.zeros(3), 0.1)
    H = hand_object_jacobian(G, np.eye(9))
    # G G' = diag(3, 3, 3, 1.5 q, 1.5 q, 3 q) with q = 1 / 4.
    assert singular_ratio(H) == pytest.approx(math.sqrt(0.375 / 3.0), abs=1e-12)
    np.testing.assert_allclose(G.T @ H @ G.T, G.T, atol=1e-12)


def test_the_object_follows_the_joints() -> None:
    """Where contacts move as a rigid body would, H finds that body's twist: turning about z at 1 rad/s."""
    angles = 2.0 * np.pi * np.arange(4) / 4
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(4)])
    positions, length = 0.05 * outward, 0.1
    velocity = np.cross([0.0, 0.0, 1.0], positions)
    G = np.vstack([np.tile(np.eye(3), 4), np.hstack([_cross(p) / length for p in positions])])
    np.testing.assert_allclose(
        hand_object_jacobian(G, velocity.reshape(-1, 1)).ravel(), [0, 0, 0, 0, 0, length], atol=1e-12
    )


def _cross(p: np.ndarray) -> np.ndarray:
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def test_a_real_grasp_has_a_ratio_between_0_and_1_that_no_frame_changes() -> None:
    pose, posture, contacts = a_grasp()
    value = uniformity(HAND, posture, pose, contacts, BOTTLE.center_of_mass, 0.1)
    assert 0.0 < value < 1.0
    turn = Pose.from_rpy([0.3, -0.2, 0.1], [0.5, -1.0, 2.0])
    R = turn.rotation.as_matrix()
    moved = tuple(GraspContact(c.link, turn.transform_points(c.position), R @ c.normal) for c in contacts)
    center = turn.transform_points(BOTTLE.center_of_mass)
    assert uniformity(HAND, posture, turn @ pose, moved, center, 0.1) == pytest.approx(value, rel=1e-9)


def test_without_contacts_or_with_too_few_joints_it_is_zero() -> None:
    pose, posture, contacts = a_grasp()
    assert uniformity(HAND, posture, pose, (), np.zeros(3), 0.1) == 0.0
    assert uniformity(HAND, posture, pose, contacts[:1], np.zeros(3), 0.1) == 0.0
