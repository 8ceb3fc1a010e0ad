"""The exact gap between a hand's shape and the object, from one of two engines behind one compiled function.

``BULLET`` asks PyBullet through a callback; ``FAST`` measures capsules and boxes against the object's triangles
in compiled code. So does ``BULLET`` with rods at an object of convex parts, and asks PyBullet whether it agrees that
they do not overlap, unless they are so far apart that it must: a call through Python costs more than the rest.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from mebo_grasp.grasping.borrowed import borrowed
from mebo_grasp.grasping.distance_field import DistanceField, on_grid, sample
from mebo_grasp.grasping.hand_arrays import BOX, MOST_SHAPES, HandArrays
from mebo_grasp.grasping.mesh_distance import box_gap, nearest_points, tracked_distance
from mebo_grasp.grasping.triangle_tree import TriangleTree, borrowed_tree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

BULLET, FAST = 0, 1
GAP_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64)
QUERY_RANGE = 0.012
"""Gaps beyond this are reported as this, metres."""
ENGINES_APART = 4e-4
"""Bound on the difference between the engines' gaps of a rod near the surface of convex parts, metres."""


ENGINE_TYPE = np.dtype(
    [
        ("kind", np.int64),
        ("pose", np.float64, (4, 4)),
        ("screened", np.int64, (MOST_SHAPES,)),
        ("nearest", np.int64, (MOST_SHAPES,)),
    ],
    align=True,
)
"""How gaps are asked for.

kind: ``BULLET`` or ``FAST``
pose: written before Bullet is asked for the gap of a shape whose group stands there
screened: whether a shape is measured by compiled code before Bullet is asked
nearest: triangle that was last nearest to each shape's axis; -1 before the first question of a trial
"""


class Engine(NamedTuple):
    """Where exact gaps come from.

    Attributes:
        ask: callback that returns Bullet's gap of a shape.
        tree: the object's triangles; for ``BULLET`` those of its convex parts, if it has any.
        state: (1,) of ``ENGINE_TYPE``.
    """

    ask: Any
    tree: TriangleTree
    state: npt.NDArray[np.void]


@njit(cache=True)
def borrowed_engine(engine: Engine) -> Engine:
    """Return an engine whose arrays are ``borrowed``."""
    return Engine(engine.ask, borrowed_tree(engine.tree), borrowed(engine.state))


@njit(cache=True)
def exact_gap(
    engine: Engine, hand: HandArrays, field: DistanceField, pose: FloatArray, shape: int, quick: bool = False
) -> float:
    """Return the gap between a shape and the object, its group standing at ``pose``; negative if they overlap.

    A screened shape's gap is the compiled one, since Bullet's to a hull can be 0.24 mm too large; but where either
    says that they overlap, they do. A quick answer leaves Bullet out wherever there is a compiled one.
    """
    state = engine.state[0]
    if state.kind == FAST or state.screened[shape]:
        gap = fast_gap(engine.tree, hand, field, pose, shape, state.nearest)
        if state.kind == FAST or quick or not 0.0 < gap <= ENGINES_APART:
            return gap
        state.pose[:] = pose
        by_bullet = engine.ask(shape)
        return gap if by_bullet > 0.0 else by_bullet
    state.pose[:] = pose
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
        return -QUERY_RANGE if inside else box_gap(tree, pose, hand.box[shape], hand.ends[shape, 0], QUERY_RANGE)
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
    return nearest_points(engine.tree, ends[0], ends[1], reach + radius, out, engine.state[0].nearest[shape]) - radius
