"""Distances between poses, compiled; with a symmetry axis, over all turns of the object about it.

Notation: a and b are poses with positions p, metres, and unit quaternions q, xyzw; w is the rotation
weight, metres a radian; u the symmetry axis, a unit vector through the object's origin, or zero for none;
phi the angle by which b is turned about u.
"""

from __future__ import annotations

import math

import numpy as np

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.grasp import FloatArray

_STEPS = 32
"""Pieces of the arc between the two best turns in which the least distance is looked for."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_REFINEMENTS = 34
"""Golden sections of a piece: its width shrinks by 1e-7."""


@borrowing
def _squared_plain(p_a: FloatArray, q_a: FloatArray, p_b: FloatArray, q_b: FloatArray, w: float) -> float:
    squared = (p_a[0] - p_b[0]) ** 2 + (p_a[1] - p_b[1]) ** 2 + (p_a[2] - p_b[2]) ** 2
    if w > 0.0:
        minus = plus = 0.0
        for k in range(4):
            minus += (q_a[k] - q_b[k]) ** 2
            plus += (q_a[k] + q_b[k]) ** 2
        # q and -q are the same rotation: the shorter of the two chords counts.
        angle = 4.0 * math.atan2(math.sqrt(min(minus, plus)), math.sqrt(max(minus, plus)))
        squared += (w * angle) ** 2
    return float(squared)


@borrowing
def _along_turned(q_a: FloatArray, v: FloatArray, q_b: FloatArray) -> float:
    """Return the scalar product of q_a with the product of the pure quaternion v and q_b."""
    x, y, z, w = q_b[0], q_b[1], q_b[2], q_b[3]
    return float(
        q_a[0] * (v[0] * w + v[1] * z - v[2] * y)
        + q_a[1] * (v[1] * w + v[2] * x - v[0] * z)
        + q_a[2] * (v[2] * w + v[0] * y - v[1] * x)
        - q_a[3] * (v[0] * x + v[1] * y + v[2] * z)
    )


@borrowing
def _squared_turned(turn: tuple[float, ...], phi: float) -> float:
    """Return the squared distance when b is turned by phi."""
    still, swing, best_swing, weight, apart, together, best_turn = turn
    k = math.sin(0.5 * (phi - best_turn))
    sine = math.sqrt(apart + together * k * k)
    cosine = math.sqrt(max(together * (1.0 - k * k), 0.0))
    return still - 2.0 * swing * math.cos(phi - best_swing) + (weight * 2.0 * math.atan2(sine, cosine)) ** 2


@compiled
def _turning(
    p_a: FloatArray, q_a: FloatArray, p_b: FloatArray, q_b: FloatArray, w: float, u: FloatArray
) -> tuple[float, ...]:
    """Return the squared distance as a function of phi.

    The squared distance of the positions is ``still - 2 swing cos(phi - best_swing)``. The cosine of half
    the angle between the rotations is ``sqrt(together) |cos((phi - best_turn) / 2)|``, and ``apart`` is
    1 - ``together``, computed by itself to be exact where it is small.
    """
    along_a = p_a[0] * u[0] + p_a[1] * u[1] + p_a[2] * u[2]
    along_b = p_b[0] * u[0] + p_b[1] * u[1] + p_b[2] * u[2]
    r_a, r_b = p_a - along_a * u, p_b - along_b * u
    still = (along_a - along_b) ** 2
    cosine = sine = 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        still += r_a[k] ** 2 + r_b[k] ** 2
        cosine += r_a[k] * r_b[k]
        sine += r_a[k] * (u[i] * r_b[j] - u[j] * r_b[i])
    v = np.zeros(3)
    v[np.argmin(np.abs(u))] = 1.0
    v -= (v[0] * u[0] + v[1] * u[1] + v[2] * u[2]) * u
    v /= math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    t = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
    same = q_a[0] * q_b[0] + q_a[1] * q_b[1] + q_a[2] * q_b[2] + q_a[3] * q_b[3]
    turned = _along_turned(q_a, u, q_b)
    apart = _along_turned(q_a, v, q_b) ** 2 + _along_turned(q_a, t, q_b) ** 2
    return (
        still,
        math.sqrt(cosine * cosine + sine * sine),
        math.atan2(sine, cosine),
        w,
        apart,
        same * same + turned * turned,
        2.0 * math.atan2(turned, same),
    )


@borrowing
def _refine(turn: tuple[float, ...], low: float, high: float) -> float:
    """Return the least squared distance between two turns by golden sections."""
    phi_1, phi_2 = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    f_1, f_2 = _squared_turned(turn, phi_1), _squared_turned(turn, phi_2)
    for _ in range(_REFINEMENTS):
        if f_1 <= f_2:
            high, phi_2, f_2 = phi_2, phi_1, f_1
            phi_1 = high - _GOLDEN * (high - low)
            f_1 = _squared_turned(turn, phi_1)
        else:
            low, phi_1, f_1 = phi_1, phi_2, f_2
            phi_2 = low + _GOLDEN * (high - low)
            f_2 = _squared_turned(turn, phi_2)
    return float(min(f_1, f_2))


@borrowing
def _squared_symmetric(
    p_a: FloatArray, q_a: FloatArray, p_b: FloatArray, q_b: FloatArray, w: float, u: FloatArray
) -> float:
    """Return the least squared distance over all turns.

    Each of the two terms grows with the way from its own best turn, so that the least sum lies on the
    shorter arc between the two best turns.
    """
    turn = _turning(p_a, q_a, p_b, q_b, w, u)
    begin, end = turn[2], turn[6]
    arc = math.atan2(math.sin(end - begin), math.cos(end - begin))
    step = arc / _STEPS
    best = math.inf
    before, here = math.inf, _squared_turned(turn, begin)
    for k in range(_STEPS + 1):
        after = _squared_turned(turn, begin + (k + 1) * step) if k < _STEPS else math.inf
        best = min(best, here)
        if here <= before and here <= after and step != 0.0:
            low, high = begin + max(k - 1, 0) * step, begin + min(k + 1, _STEPS) * step
            best = min(best, _refine(turn, low, high))
        before, here = here, after
    return max(best, 0.0)


@borrowing
def pose_distance(p_a: FloatArray, q_a: FloatArray, p_b: FloatArray, q_b: FloatArray, w: float, u: FloatArray) -> float:
    """Return the distance between two poses, metres.

    Args:
        p_a: position, shape (3,), metres.
        q_a: quaternion xyzw, shape (4,).
        p_b: position, shape (3,), metres.
        q_b: quaternion xyzw, shape (4,).
        w: rotation weight, metres a radian.
        u: symmetry axis, shape (3,), unit or zero.
    """
    if u[0] == 0.0 and u[1] == 0.0 and u[2] == 0.0:
        return math.sqrt(_squared_plain(p_a, q_a, p_b, q_b, w))
    return math.sqrt(_squared_symmetric(p_a, q_a, p_b, q_b, w, u))


@compiled
def distances_to_many(
    p_a: FloatArray, q_a: FloatArray, positions: FloatArray, quaternions: FloatArray, w: float, u: FloatArray
) -> FloatArray:
    """Return the distances from one pose to n others, shape (n,), metres."""
    distances = np.empty(len(positions))
    for i in range(len(positions)):
        distances[i] = pose_distance(p_a, q_a, positions[i], quaternions[i], w, u)
    return distances


@compiled
def distance_table(positions: FloatArray, quaternions: FloatArray, w: float, u: FloatArray) -> FloatArray:
    """Return all mutual distances of n poses, shape (n, n), metres."""
    n = len(positions)
    table = np.zeros((n, n))
    for i in range(n):
        for k in range(i):
            table[i, k] = pose_distance(positions[i], quaternions[i], positions[k], quaternions[k], w, u)
            table[k, i] = table[i, k]
    return table
