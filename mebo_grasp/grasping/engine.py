"""The exact gap between a hand's shape and the object, from one of two engines behind one compiled function.

``BULLET`` asks PyBullet through a callback; ``FAST`` measures capsules and boxes against the object's triangles
in compiled code. Where the compiled gap of a rod is so far from 0 that Bullet's cannot have another sign, Bullet
is not asked: a call through Python costs more than the rest.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.distance_field import DistanceField, on_grid, sample
from mebo_grasp.grasping.hand_arrays import BOX, HandArrays
from mebo_grasp.grasping.mesh_distance import box_gap, nearest_points, tracked_distance
from mebo_grasp.grasping.triangle_tree import TriangleTree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

BULLET, FAST = 0, 1
GAP_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64)
QUERY_RANGE = 0.012
"""Gaps beyond this are reported as this, metres."""
ENGINES_APART = 4e-4
"""Bound on the difference between the engines' gaps of a rod near the surface of convex parts, metres."""
SURELY_FREE = 1e-4
"""A bound on a gap is given only where it exceeds this, since nearer ones are compared with a tolerance, metres."""


class Engine(NamedTuple):
    """Where exact gaps come from.

    Attributes:
        kind: ``BULLET`` or ``FAST``.
        ask: callback that returns the gap of a shape whose group stands at ``pose``.
        pose: (4, 4) written before ``ask`` is called.
        tree: the object's triangles; for ``BULLET`` those of its convex parts, if it has any.
        screened: (n,) which shapes are measured by compiled code before Bullet is asked.
        nearest: (n,) triangle that was last nearest to each shape's axis; -1 before the first question of a trial.
    """

    kind: int
    ask: Any
    pose: FloatArray
    tree: TriangleTree
    screened: npt.NDArray[np.bool_]
    nearest: IntArray


@njit(cache=True)
def exact_gap(
    engine: Engine, hand: HandArrays, field: DistanceField, pose: FloatArray, shape: int, quick: bool = False
) -> float:
    """Return the gap between a shape and the object, its group standing at ``pose``; negative if they overlap.

    Within ``ENGINES_APART`` of touching it is the engine's own; farther off it may be a bound on that. A quick answer
    is the compiled one wherever that is near the engine's.
    """
    if engine.kind == FAST or engine.screened[shape]:
        gap = fast_gap(engine.tree, hand, field, pose, shape, engine.nearest)
        if engine.kind == FAST or quick:
            return gap
        if gap > ENGINES_APART + SURELY_FREE:
            return gap - ENGINES_APART
        if gap < -ENGINES_APART:
            return gap
    engine.pose[:] = pose
    return engine.ask(shape)


@njit(cache=True)
def fast_gap(
    tree: TriangleTree, hand: HandArrays, field: DistanceField, pose: FloatArray, shape: int, nearest: IntArray
) -> float:
    """Return the gap of a capsule, sphere or box measured against the object's triangles."""
    ends = np.empty((2, 3))
    for which in range(2):
        c = hand.ends[shape, which]
        for k in range(3):
            ends[which, k] = pose[k, 0] * c[0] + pose[k, 1] * c[1] + pose[k, 2] * c[2] + pose[k, 3]
    depth = -sample(field, ends[0, 0], ends[0, 1], ends[0, 2])
    inside = depth > field.slack
    if hand.kind[shape] == BOX:
        return (
            -QUERY_RANGE if inside else box_gap(tree, pose, hand.box[shape], hand.ends[shape, 0], QUERY_RANGE)
        )
    radius = hand.radius[shape]
    if inside:
        return -radius
    bound = QUERY_RANGE + radius if nearest[shape] >= 0 else _axis_bound(hand, field, pose, shape)
    distance = tracked_distance(tree, ends[0], ends[1], bound, nearest, shape)
    # On a coarse grid a thin rod may lie inside although the grid cannot prove it: then the better guess decides.
    if distance > radius and depth > 0.0:
        return -radius
    return distance - radius


@njit(cache=True)
def _axis_bound(hand: HandArrays, field: DistanceField, pose: FloatArray, shape: int) -> float:
    """Bound the distance of a rod's axis, on which its covering spheres are centred, by the field's values there."""
    bound = QUERY_RANGE + hand.radius[shape]
    for i in range(hand.sphere_start[shape], hand.sphere_start[shape + 1]):
        c = hand.sphere_center[i]
        x = pose[0, 0] * c[0] + pose[0, 1] * c[1] + pose[0, 2] * c[2] + pose[0, 3]
        y = pose[1, 0] * c[0] + pose[1, 1] * c[1] + pose[1, 2] * c[2] + pose[1, 3]
        z = pose[2, 0] * c[0] + pose[2, 1] * c[1] + pose[2, 2] * c[2] + pose[2, 3]
        if on_grid(field, x, y, z):
            bound = min(bound, abs(sample(field, x, y, z)) + field.slack)
    return bound


@njit(cache=True)
def fast_contact(
    engine: Engine, hand: HandArrays, pose: FloatArray, shape: int, reach: float, out: FloatArray
) -> float:
    """Write a capsule's point nearest to the object and the object's into ``out``, shape (2, 3); return the gap.

    Returns ``reach`` and writes nothing if the gap is no smaller. The first point is on the capsule's axis.
    """
    ends = np.empty((2, 3))
    for which in range(2):
        c = hand.ends[shape, which]
        for k in range(3):
            ends[which, k] = pose[k, 0] * c[0] + pose[k, 1] * c[1] + pose[k, 2] * c[2] + pose[k, 3]
    radius = hand.radius[shape]
    return nearest_points(engine.tree, ends[0], ends[1], reach + radius, out, engine.nearest[shape]) - radius
