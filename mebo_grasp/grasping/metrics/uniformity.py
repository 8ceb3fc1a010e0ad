"""Uniformity of transformation: how evenly the closing joints can move the object (thesis 2.2.1, Q_UOT).

Notation
    J_h: (3n, j) hand Jacobian, velocities of the contact points on the links for unit joint velocities
    G:   (6, 3n) grasp matrix; G' maps the object's twist to velocities of its points at the contacts
    H:   (6, j) hand-object Jacobian, twist of the object = H times joint velocities; H = (G')^+ J_h
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import GraspContact, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.metrics.contact_models import grasp_matrix, singular_ratio
from mebo_grasp.grasping.wrench_space import contact_frames

FloatArray = npt.NDArray[np.float64]


def hand_jacobian(
    hand: HandModel, posture: HandPosture, T_object_tcp: Pose, contacts: Sequence[GraspContact]
) -> FloatArray:
    """Return the velocity of each contact point with its link for unit velocities of the closing joints.

    Args:
        hand: the hand.
        posture: its joint values.
        T_object_tcp: where it stands.
        contacts: contact points, object frame.

    Returns:
        Shape (n, 3, j), m/rad, object frame; joints in the order of the fingers and, within, from the palm.
    """
    T_object = T_object_tcp.matrix
    transforms = {link: T_object @ T for link, T in hand.link_transforms(posture).items()}
    joints = [hand.urdf.joint(name) for finger in hand.fingers for name in finger.joints]
    moved = [_links_moved(hand, joint.name) for joint in joints]
    J = np.zeros((len(contacts), 3, len(joints)))
    for column, joint in enumerate(joints):
        T = transforms[joint.parent] @ joint.T_parent_joint
        axis, origin = T[:3, :3] @ joint.axis, T[:3, 3]
        for row, contact in enumerate(contacts):
            if contact.link in moved[column]:
                J[row, :, column] = np.cross(axis, contact.position - origin)
    return J


def _links_moved(hand: HandModel, joint_name: str) -> set[str]:
    """Return the links that a joint carries."""
    moved = {hand.urdf.joint(joint_name).child}
    for joint in hand.urdf.joints:  # from the root outwards
        if joint.parent in moved:
            moved.add(joint.child)
    return moved


def hand_object_jacobian(G: FloatArray, J_h: FloatArray) -> FloatArray:
    """Return H = (G')^+ J_h, shape (6, j): the object's twist that fits the contact velocities best.

    Args:
        G: grasp matrix, shape (6, k).
        J_h: hand Jacobian in the same contact components, shape (k, j).
    """
    H: FloatArray = np.linalg.pinv(G.T) @ J_h
    return H


def uniformity(
    hand: HandModel,
    posture: HandPosture,
    T_object_tcp: Pose,
    contacts: Sequence[GraspContact],
    center: npt.ArrayLike,
    torque_length: float,
) -> float:
    """Return Q_UOT = sigma_min(H) / sigma_max(H), in [0, 1]; contacts are hard.

    It is 0 if some motion of the object is out of the joints' reach: with fewer than six closing joints on touching
    fingers, or with contacts from which the object's motion cannot be told (all on one line).

    Args:
        hand: the hand.
        posture: its joint values.
        T_object_tcp: where it stands.
        contacts: contacts in the object's frame.
        center: point about which the object turns, shape (3,), metres.
        torque_length: metres by which torques are divided, and turns multiplied.
    """
    if not contacts:
        return 0.0
    positions = np.array([contact.position for contact in contacts])
    normals = np.array([contact.normal for contact in contacts])
    G = grasp_matrix("hard", positions, normals, center, torque_length)
    if singular_ratio(G) == 0.0:
        return 0.0
    J = np.einsum("nak,nkj->naj", contact_frames(normals), hand_jacobian(hand, posture, T_object_tcp, contacts))
    return singular_ratio(hand_object_jacobian(G, J.reshape(-1, J.shape[2])))
