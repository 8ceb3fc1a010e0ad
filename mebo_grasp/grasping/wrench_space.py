"""The grasp wrench space of a set of contacts, and the figures read from it (thesis, section 2.2.2).

A contact with friction pushes along a cone about the inward normal with half angle atan(mu), approximated by
a pyramid of m unit edges. Each edge f gives the wrench (f, (p - c) x f / L). With the sum of all contact
forces limited to 1, the grasp wrench space is the convex hull of all edge wrenches (Ferrari and Canny, 1992).
The torque scale L (metres) makes torques comparable with forces; see docs/grasp_metrics.md.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.polytope import hull_volume, origin_distance

FloatArray = npt.NDArray[np.float64]

FORCE_CLOSURE_EPSILON = 1e-6
"""A grasp is in force closure if the ball about the origin is larger than this (rounding leaves about 1e-10)."""


def cone_edges(normals: FloatArray, friction: float, edges: int) -> FloatArray:
    """Return the unit edges of the friction pyramids, shape (n, edges, 3).

    Args:
        normals: unit inward normals, shape (n, 3).
        friction: coefficient of friction, at least 0.
        edges: edges of a pyramid, at least 3; a frictionless contact has the normal alone.
    """
    if not (np.isfinite(friction) and friction >= 0.0):
        raise InvalidSettingsError(f"friction {friction} must be a finite number, at least 0")
    if friction == 0.0:
        return normals[:, None, :].copy()
    if edges < 3:
        raise InvalidSettingsError(f"a friction pyramid needs at least 3 edges, got {edges}")
    tangents, bitangents = _tangents(normals)
    angles = 2.0 * np.pi * np.arange(edges) / edges
    rim = (
        np.cos(angles)[None, :, None] * tangents[:, None, :]
        + np.sin(angles)[None, :, None] * bitangents[:, None, :]
    )
    directions: FloatArray = (normals[:, None, :] + friction * rim) / np.sqrt(1.0 + friction * friction)
    return directions


def _tangents(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors that complete each normal: the images of x and y under the shortest turn from z."""
    x, y, z = normals.T
    # Turning z onto n by the shortest way; for n = -z any half turn will do, here the one about x.
    # 1 / (1 + z) loses all its digits near z = -1; with x^2 + y^2 = (1 + z) (1 - z) it keeps them.
    across = x * x + y * y
    below = (z < 0.0) & (across < 1e-24)
    k = np.where(
        z < 0.0, (1.0 - z) / np.where(below, 1.0, np.maximum(across, 1e-24)), 1.0 / (1.0 + np.abs(z))
    )
    k[below] = 0.0
    tangents = np.column_stack([1.0 - k * x * x, -k * x * y, -x])
    bitangents = np.column_stack([-k * x * y, 1.0 - k * y * y, -y])
    tangents[below] = (1.0, 0.0, 0.0)
    bitangents[below] = (0.0, -1.0, 0.0)
    return tangents, bitangents


def contact_wrenches(
    positions: npt.ArrayLike,
    normals: npt.ArrayLike,
    friction: float,
    edges: int,
    center: npt.ArrayLike,
    torque_length: float,
) -> FloatArray:
    """Return the wrenches of all pyramid edges, shape (n * edges, 6): force, then torque over ``torque_length``.

    Args:
        positions: contact points, shape (n, 3), metres.
        normals: unit normals into the object, shape (n, 3).
        friction: coefficient of friction.
        edges: edges of a pyramid.
        center: point about which torques are taken, shape (3,), metres.
        torque_length: metres by which torques are divided.

    Raises:
        InvalidSettingsError: friction, edges or torque length out of range, or contacts that are not finite or
            do not have one normal each.
    """
    if not (np.isfinite(torque_length) and torque_length > 0.0):
        raise InvalidSettingsError(f"torque length {torque_length} must be a positive number of metres")
    p = np.asarray(positions, dtype=np.float64).reshape(-1, 3) - np.asarray(center, dtype=np.float64)
    n = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    if p.shape != n.shape or not (np.isfinite(p).all() and np.isfinite(n).all()):
        raise InvalidSettingsError(
            f"contacts must be finite, one normal each; got {len(p)} and {len(n)} normals"
        )
    forces = cone_edges(n, friction, edges)
    torques = np.cross(p[:, None, :], forces) / torque_length
    return np.concatenate([forces, torques], axis=2).reshape(-1, 6)


def epsilon(wrenches: FloatArray) -> float:
    """Return the radius of the largest origin-centred ball in the wrench hull; 0 if the origin is not inside."""
    return 0.0 if len(wrenches) < 7 else origin_distance(wrenches)


def volume(wrenches: FloatArray) -> float:
    """Return the six-dimensional volume of the wrench hull; 0 when it is flat."""
    return 0.0 if len(wrenches) < 7 else hull_volume(wrenches)


def force_closure(epsilon_value: float) -> bool:
    """Whether the origin lies inside the wrench hull."""
    return epsilon_value > FORCE_CLOSURE_EPSILON


def isotropy(
    positions: npt.ArrayLike, normals: npt.ArrayLike, center: npt.ArrayLike, torque_length: float
) -> float:
    """Return the grasp isotropy index: smallest over largest singular value of the grasp matrix (thesis 2.2.1).

    The grasp matrix of hard contacts with friction maps the three force components of every contact to the
    object's wrench. Its rank is below 6, and the index 0, for fewer than three contacts not in line.
    """
    p = np.asarray(positions, dtype=np.float64).reshape(-1, 3) - np.asarray(center, dtype=np.float64)
    n = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    if len(p) == 0:
        return 0.0
    tangents, bitangents = _tangents(n)
    axes = np.stack([n, tangents, bitangents], axis=1).reshape(-1, 3)
    arms = np.repeat(p, 3, axis=0)
    G = np.vstack([axes.T, np.cross(arms, axes).T / torque_length])
    singular = np.linalg.svd(G, compute_uv=False)
    if singular[0] <= 0.0 or len(singular) < 6:
        return 0.0
    index = float(singular[-1] / singular[0])
    return index if index > 1e-12 else 0.0
