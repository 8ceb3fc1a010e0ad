"""What a contact can transmit: a push, a push with friction, or these and a torque about the normal.

The three contact types of the thesis, section 2.2.1. A soft finger has an area of contact, so that it also resists
turning about its normal: a normal force f carries a torque of up to gamma f, gamma in metres. For even pressure on
a patch of radius a, gamma = 2/3 mu a (Howe, Kao and Cutkosky, 1988); here it is a setting of its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.wrench_space import contact_frames, contact_wrenches

FloatArray = npt.NDArray[np.float64]


def model_wrenches(
    model: str,
    positions: npt.ArrayLike,
    normals: npt.ArrayLike,
    friction: float,
    edges: int,
    center: npt.ArrayLike,
    torque_length: float,
    torsion: float = 0.0,
) -> FloatArray:
    """Return the wrenches that unit contact forces give, contact by contact, shape (n * k, 6).

    k is 1 for "frictionless", ``edges`` for "hard" and ``edges`` + 2 for "soft": the friction pyramid, and a push
    along the normal with the largest torque about it either way. The hull of these lies within the set of forces
    whose friction and torque obey (f_t / mu)^2 + (tau / gamma)^2 <= f_n^2.

    Args:
        model: "frictionless", "hard" or "soft".
        positions: contact points, shape (n, 3), metres.
        normals: unit normals into the object, shape (n, 3).
        friction: coefficient of friction; a frictionless contact has none.
        edges: edges of a friction pyramid.
        center: point about which torques are taken, shape (3,), metres.
        torque_length: metres by which torques are divided.
        torsion: gamma, metres; used by "soft" only.

    Raises:
        InvalidSettingsError: an unknown model, or a value out of range.
    """
    if model == "frictionless":
        return contact_wrenches(positions, normals, 0.0, edges, center, torque_length)
    hard = contact_wrenches(positions, normals, friction, edges, center, torque_length)
    if model == "hard":
        return hard
    if model != "soft":
        raise InvalidSettingsError(f"contact model '{model}' is unknown; use frictionless, hard or soft")
    if not (np.isfinite(torsion) and torsion >= 0.0):
        raise InvalidSettingsError(f"torsion {torsion} must be a finite number of metres, at least 0")
    n = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    push = contact_wrenches(positions, n, 0.0, edges, center, torque_length)
    turn = np.hstack([np.zeros_like(n), torsion * n / torque_length])
    per_contact = [hard.reshape(len(n), -1, 6), (push + turn)[:, None, :], (push - turn)[:, None, :]]
    wrenches: FloatArray = np.concatenate(per_contact, axis=1).reshape(-1, 6)
    return wrenches


def grasp_matrix(
    model: str,
    positions: npt.ArrayLike,
    normals: npt.ArrayLike,
    center: npt.ArrayLike,
    torque_length: float,
) -> FloatArray:
    """Return the grasp matrix G, shape (6, n c): wrench on the object for each force component of each contact.

    Components are the normal alone (frictionless, c = 1), normal and two tangents (hard, c = 3), or these and the
    torque about the normal in units of ``torque_length`` (soft, c = 4).

    Args:
        model: "frictionless", "hard" or "soft".
        positions: contact points, shape (n, 3), metres.
        normals: unit normals into the object, shape (n, 3).
        center: point about which torques are taken, shape (3,), metres.
        torque_length: metres by which torques are divided.
    """
    p = np.asarray(positions, dtype=np.float64).reshape(-1, 3) - np.asarray(center, dtype=np.float64)
    n = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    axes = contact_frames(np.ascontiguousarray(n))[:, : 1 if model == "frictionless" else 3]
    torques = np.cross(p[:, None, :], axes) / torque_length
    columns = np.concatenate([axes, torques], axis=2)
    if model == "soft":
        turns = np.hstack([np.zeros_like(n), n])[:, None, :]
        columns = np.concatenate([columns, turns], axis=1)
    G: FloatArray = columns.reshape(-1, 6).T
    return G


def singular_ratio(matrix: FloatArray) -> float:
    """Return smallest over largest of six singular values, in [0, 1]; 0 for rank below 6 or under 1e-12."""
    if matrix.size == 0 or min(matrix.shape) < 6:
        return 0.0
    singular = np.linalg.svd(matrix, compute_uv=False)
    if not singular[0] > 0.0:
        return 0.0
    ratio = float(singular[5] / singular[0])
    return ratio if ratio > 1e-12 else 0.0
