"""How many grasps a search has looked at, and how many of them were blocked, compiled."""

from __future__ import annotations

import numpy as np

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.solutions.bounding_tree import LEAF, BoundingTree
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.grasp_columns import Grasps, NodeBounds

NOTHING = -1
"""Instead of the last grasp: the search did not end with one, it looked at all."""


@borrowing
def _is_up_to(grasps: Grasps, row: int, last: int, least: float) -> bool:
    """Tell whether a grasp was looked at by a search that ended with the grasp ``last``."""
    quality = grasps.qualities[row]
    if last == NOTHING or quality != least:
        return bool(quality >= least)
    return bool(grasps.stamps[row] <= grasps.stamps[last])


@compiled
def _count_all(grasps: Grasps, last: int, least: float) -> int:
    above = equal = 0
    # Without a branch, so that the compiler takes several at a time.
    for quality in grasps.qualities:
        above += quality > least
        equal += quality == least
    if last == NOTHING or equal == 1:
        return above + equal
    for row in np.flatnonzero(grasps.qualities == least):
        above += grasps.stamps[row] <= grasps.stamps[last]
    return above


@compiled
def _count_node(tree: BoundingTree, bounds: NodeBounds, grasps: Grasps, root: int, last: int, least: float) -> int:
    """Count the grasps of a node that were looked at, without going into parts that were as a whole."""
    total = 0
    waiting = [root]
    while len(waiting) > 0:
        node = waiting.pop()
        if bounds.best[node] < least:
            continue
        if bounds.worst[node] > least:
            total += tree.end[node] - tree.begin[node]
        elif tree.left[node] != LEAF:
            waiting.append(tree.left[node])
            waiting.append(tree.left[node] + 1)
        else:
            for row in tree.order[tree.begin[node] : tree.end[node]]:
                if not _is_up_to(grasps, row, last, least):
                    break  # a leaf is sorted, best first
                total += 1
    return total


@compiled
def count_looked_at(
    tree: BoundingTree,
    bounds: NodeBounds,
    grasps: Grasps,
    shapes: int,
    min_quality: float,
    last: int,
    blocked_grasps: list[tuple[int, int]],
    blocked_nodes: list[tuple[int, int]],
) -> tuple[int, IntArray]:
    """Count the grasps that were looked at, and the blocked ones among them.

    Args:
        tree: over the first grasps.
        bounds: of its nodes.
        grasps: all of them.
        shapes: number of occlusions.
        min_quality: least quality asked for.
        last: row of the last grasp found, if the search ended with it, or ``NOTHING``.
        blocked_grasps: rows and what blocks them; some may be worse than ``last``.
        blocked_nodes: nodes that are blocked as a whole and by what.

    Returns:
        Number of grasps looked at, and number blocked by each occlusion, shape (s,).
    """
    least = min_quality if last == NOTHING else grasps.qualities[last]
    blocked = np.zeros(shapes, np.int64)
    for row, shape in blocked_grasps:
        blocked[shape] += _is_up_to(grasps, row, last, least)
    for node, shape in blocked_nodes:
        blocked[shape] += _count_node(tree, bounds, grasps, node, last, least)
    return _count_all(grasps, last, least), blocked
