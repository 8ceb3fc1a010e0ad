"""The grasp wrench space of a set of contacts, and the figures read from it (thesis, section 2.2.2).

A contact with friction pushes along a cone about the inward normal with half angle atan(mu), approximated by
a pyramid of m unit edges. Each edge f gives the wrench (f, (p - c) x f / L). With the sum of all contact
forces limited to 1, the grasp wrench space is the convex hull of all edge wrenches (Ferrari and Canny, 1992).
The torque scale L (metres) makes torques comparable with forces; see docs/grasp_metrics.md.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.hull_volume import hull_volume
from mebo_grasp.grasping.origin_distance import origin_distance

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
    directions = np.empty((len(normals), edges, 3))
    _fill_cones(np.ascontiguousarray(normals), friction, directions)
    return directions


@njit(cache=True)
def _fill_cones(normals: FloatArray, friction: float, directions: FloatArray) -> None:
    """Write the unit edges of each pyramid, shape (n, edges, 3)."""
    edges, scale = directions.shape[1], 1.0 / np.sqrt(1.0 + friction * friction)
    frames = contact_frames(normals)
    for i in range(len(normals)):
        frame = frames[i]
        for j in range(edges):
            angle = 2.0 * np.pi * j / edges
            c, s = friction * np.cos(angle), friction * np.sin(angle)
            for k in range(3):
                directions[i, j, k] = scale * (frame[0, k] + c * frame[1, k] + s * frame[2, k])


@njit(cache=True)
def contact_frames(normals: FloatArray) -> FloatArray:
    """Return for each unit normal, shape (n, 3), itself and two unit tangents as rows, shape (n, 3, 3)."""
    frames = np.empty((len(normals), 3, 3))
    for i in range(len(normals)):
        _contact_frame(normals[i], frames[i])
    return frames


@njit(cache=True)
def _contact_frame(normal: FloatArray, frame: FloatArray) -> None:
    """Write a unit normal and two unit tangents as the rows of ``frame``, shape (3, 3).

    The tangents are the images of x and y under the shortest turn from z to the normal.
    """
    x, y, z = normal[0], normal[1], normal[2]
    frame[0] = normal
    # 1 / (1 + z) loses all its digits near z = -1; with x^2 + y^2 = (1 + z) (1 - z) it keeps them.
    across = x * x + y * y
    if z < 0.0 and across < 1e-24:
        # For n = -z any half turn will do, here the one about x.
        frame[1, 0], frame[1, 1], frame[1, 2] = 1.0, 0.0, 0.0
        frame[2, 0], frame[2, 1], frame[2, 2] = 0.0, -1.0, 0.0
        return
    k = (1.0 - z) / across if z < 0.0 else 1.0 / (1.0 + z)
    frame[1, 0], frame[1, 1], frame[1, 2] = 1.0 - k * x * x, -k * x * y, -x
    frame[2, 0], frame[2, 1], frame[2, 2] = -k * x * y, 1.0 - k * y * y, -y


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
        raise InvalidSettingsError(f"contacts must be finite, one normal each; got {len(p)} and {len(n)} normals")
    return _with_torques(p, cone_edges(n, friction, edges), torque_length)


@njit(cache=True)
def _with_torques(arms: FloatArray, forces: FloatArray, torque_length: float) -> FloatArray:
    """Return the wrenches, shape (n * m, 6), of m forces at each of n points, shapes (n, m, 3) and (n, 3)."""
    n, m = forces.shape[:2]
    wrenches = np.empty((n * m, 6))
    for i in range(n):
        a = arms[i]
        for j in range(m):
            f, w = forces[i, j], wrenches[i * m + j]
            w[:3] = f
            w[3] = (a[1] * f[2] - a[2] * f[1]) / torque_length
            w[4] = (a[2] * f[0] - a[0] * f[2]) / torque_length
            w[5] = (a[0] * f[1] - a[1] * f[0]) / torque_length
    return wrenches


def epsilon(wrenches: FloatArray) -> float:
    """Return the radius of the largest origin-centred ball in the wrench hull; 0 if the origin is not inside."""
    return 0.0 if len(wrenches) < 7 else origin_distance(wrenches)


def volume(wrenches: FloatArray) -> float:
    """Return the six-dimensional volume of the wrench hull; 0 when it is flat."""
    return 0.0 if len(wrenches) < 7 else hull_volume(wrenches)


def force_closure(epsilon_value: float) -> bool:
    """Whether the origin lies inside the wrench hull."""
    return epsilon_value > FORCE_CLOSURE_EPSILON


def isotropy(positions: npt.ArrayLike, normals: npt.ArrayLike, center: npt.ArrayLike, torque_length: float) -> float:
    """Return the grasp isotropy index: smallest over largest singular value of the grasp matrix (thesis 2.2.1).

    The grasp matrix of hard contacts with friction maps the three force components of every contact to the
    object's wrench. Its rank is below 6, and the index 0, for fewer than three contacts not in line.
    """
    p = np.asarray(positions, dtype=np.float64).reshape(-1, 3) - np.asarray(center, dtype=np.float64)
    n = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    return float(_isotropy(p, np.ascontiguousarray(n), torque_length))


@njit(cache=True)
def _isotropy(arms: FloatArray, normals: FloatArray, torque_length: float) -> float:
    """Return the grasp isotropy index of hard contacts at ``arms`` from the centre, shapes (n, 3)."""
    if len(arms) < 2:
        return 0.0
    G = _with_torques(arms, contact_frames(normals), torque_length)
    singular = np.linalg.svd(G, full_matrices=False)[1]
    index = singular[-1] / singular[0]
    return index if index > 1e-12 else 0.0


@njit(cache=True)
def hard_contacts(
    positions: FloatArray, normals: FloatArray, friction: float, edges: int, center: FloatArray, torque_length: float
) -> tuple[FloatArray, float]:
    """Return ``contact_wrenches`` and ``isotropy`` at one go, for contacts and settings known to be sound."""
    arms = positions - center
    if friction > 0.0:
        directions = np.empty((len(normals), edges, 3))
        _fill_cones(normals, friction, directions)
    else:
        directions = normals.copy().reshape(-1, 1, 3)
    return _with_torques(arms, directions, torque_length), _isotropy(arms, normals, torque_length)
