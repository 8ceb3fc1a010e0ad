"""The best grasps that nothing blocks, out of a million, by looking at the most promising first.

A ``BoundingTree`` over one point of each hand carries for every node the best quality in it. Nodes are
taken from a heap, best first. A node that lies in an occlusion as a whole is rejected as a whole; an
occlusion out of reach of a node is not asked again below it. A leaf, sorted by quality, has one grasp
on the heap at a time, which is looked at when it comes out. It is then better than all that is left, so
that the search ends with the last grasp wanted and looks at none beyond it.
"""

from __future__ import annotations

import heapq
import math
from typing import Any

import numpy as np
from numba import uint64

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.bounding_tree import LEAF, BoundingTree
from mebo_grasp.solutions.counting import NOTHING, count_looked_at
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.grasp_columns import Grasps, NodeBounds, Wanted
from mebo_grasp.solutions.hand_check import (
    BALL,
    FREE,
    MASKED_SHAPES,
    MOST_SEGMENTS,
    Desk,
    ask_hand,
    ask_recent,
    is_masked_out,
    make_desk,
    remember,
    segments_of,
)
from mebo_grasp.solutions.pose_distance import pose_distance
from mebo_grasp.solutions.signed_distance import Scene, distance_to, is_beyond

NODE, GRASP = 0, 1
"""What stands on the heap; of equal qualities the nodes come first, as they may hold earlier stamps."""
UNDECIDED = -2


# Quality (negative: the least comes first), NODE or GRASP, stamp, then of a node: its number, the occlusions
# still to be asked below it; of a grasp: its place in the order, the occlusions still to be asked, and where the
# sorted run ends that it begins.
HeapItem = tuple[Any, ...]
# The heap; blocked grasps and blocked nodes, each with one occlusion that blocks it.
Progress = tuple[list[HeapItem], list[tuple[Any, Any]], list[tuple[Any, Any]]]


@compiled
def sort_leaves(tree: BoundingTree, qualities: FloatArray, stamps: IntArray) -> None:
    """Sort each leaf of the tree by quality, best first, equal ones by stamp."""
    for node in range(len(tree.left)):
        if tree.left[node] != LEAF:
            continue
        rows = tree.order[tree.begin[node] : tree.end[node]]
        # Taken out once: they lie all over the memory.
        y, t = qualities[rows], stamps[rows]
        for i in range(1, len(rows)):
            row, quality, stamp, k = rows[i], y[i], t[i], i
            while k > 0 and (quality > y[k - 1] or (quality == y[k - 1] and stamp < t[k - 1])):
                rows[k], y[k], t[k] = rows[k - 1], y[k - 1], t[k - 1]
                k -= 1
            rows[k], y[k], t[k] = row, quality, stamp


@compiled
def node_bounds(tree: BoundingTree, grasps: Grasps) -> NodeBounds:
    """Gather what holds for all grasps of each node."""
    k = len(tree.left)
    best, worst = np.empty(k), np.empty(k)
    inner, outer = np.empty(k), np.empty(k)
    for node in range(k - 1, -1, -1):  # children stand behind their parent
        left = tree.left[node]
        if left != LEAF:
            best[node] = max(best[left], best[left + 1])
            worst[node] = min(worst[left], worst[left + 1])
            inner[node] = min(inner[left], inner[left + 1])
            outer[node] = max(outer[left], outer[left + 1])
            continue
        best[node], worst[node], inner[node], outer[node] = -np.inf, np.inf, np.inf, -np.inf
        for row in tree.order[tree.begin[node] : tree.end[node]]:
            best[node] = max(best[node], grasps.qualities[row])
            worst[node] = min(worst[node], grasps.qualities[row])
            inner[node] = min(inner[node], grasps.inner[row])
            outer[node] = max(outer[node], grasps.outer[row])
    return NodeBounds(best, worst, inner, outer)


@borrowing
def _is_diverse(grasps: Grasps, row: int, taken: IntArray, wanted: Wanted) -> bool:
    if wanted.min_distance <= 0.0:
        return True
    for other in taken:
        distance = pose_distance(
            grasps.positions[row],
            grasps.quaternions[row],
            grasps.positions[other],
            grasps.quaternions[other],
            wanted.rotation_weight,
            wanted.symmetry_axis,
        )
        if distance < wanted.min_distance:
            return False
    return True


@compiled
def _length(v: FloatArray) -> float:
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@borrowing
def _look_at_grasp(scene: Scene, grasps: Grasps, row: int, mask: int, reach: float) -> tuple[int, int]:
    """Return a shape that blocks for sure, FREE or UNDECIDED, and the shapes that remain to be asked."""
    x, y, z = grasps.points[row, 0], grasps.points[row, 1], grasps.points[row, 2]
    inner, outer = grasps.inner[row], grasps.outer[row] + reach
    shapes, rest, verdict = scene.shapes, uint64(0), FREE
    for shape in range(len(shapes)):
        if is_masked_out(mask, shape):
            continue
        if is_beyond(shapes, shape, x, y, z, outer):
            continue
        if not is_beyond(shapes, shape, x, y, z, inner) and (distance_to(shapes, scene, shape, x, y, z) <= inner):
            return shape, uint64(0)
        if outer > 0.0:
            verdict = UNDECIDED
            # Shapes beyond the mask are asked again whenever the mask is not empty.
            rest |= uint64(1) << uint64(min(shape, MASKED_SHAPES))
    return verdict, rest


@borrowing
def _look_at_node(
    scene: Scene, tree: BoundingTree, bounds: NodeBounds, node: int, mask: int, reach: float
) -> tuple[int, int]:
    """Return a shape that blocks all of the node, or FREE, and the shapes that may block some of it."""
    x = 0.5 * (tree.low[node, 0] + tree.high[node, 0])
    y = 0.5 * (tree.low[node, 1] + tree.high[node, 1])
    z = 0.5 * (tree.low[node, 2] + tree.high[node, 2])
    half = 0.0
    for axis in range(3):
        half += (0.5 * (tree.high[node, axis] - tree.low[node, axis])) ** 2
    half = math.sqrt(half) * (1.0 + 1e-12)
    inner, outer = bounds.inner[node] - half, bounds.outer[node] + reach + half
    shapes = scene.shapes
    for shape in range(min(len(shapes), MASKED_SHAPES)):
        if is_masked_out(mask, shape):
            continue
        if is_beyond(shapes, shape, x, y, z, outer):
            mask &= ~(uint64(1) << uint64(shape))
            continue
        distance = distance_to(shapes, scene, shape, x, y, z)
        if distance <= inner:
            return shape, uint64(0)
        if distance > outer:
            mask &= ~(uint64(1) << uint64(shape))
    return FREE, mask


@borrowing
def _is_near_taken(tree: BoundingTree, grasps: Grasps, node: int, taken: IntArray, wanted: Wanted) -> bool:
    """Tell whether no grasp of the node can be diverse from all that are taken."""
    for other in taken:
        squared = (wanted.rotation_weight * math.pi) ** 2
        for axis in range(3):
            x = grasps.positions[other, axis]
            squared += max(tree.high[node, axis] - x, x - tree.low[node, axis]) ** 2
        if squared * (1.0 + 1e-9) < wanted.min_distance**2:
            return True
    return False


@borrowing
def _next_of_run(grasps: Grasps, mask: int, begin: int, end: int, wanted: Wanted, taken: IntArray) -> int:
    """Return the first place of a sorted run of the order that may be an answer or is blocked, or its end."""
    for k in range(begin, end):
        row = grasps.order[k]
        if grasps.qualities[row] < wanted.min_quality:
            return end
        if mask != uint64(0) or _is_diverse(grasps, row, taken, wanted):
            return k
    return end


@borrowing
def _as_item(grasps: Grasps, k: int, mask: int, end: int) -> HeapItem:
    """Return what stands on the heap for the sorted run of the order from k to end."""
    row = grasps.order[k]
    return -grasps.qualities[row], GRASP, grasps.stamps[row], np.int64(k), mask, np.int64(end)


@borrowing
def _blocker(scene: Scene, grasps: Grasps, row: int, mask: int, wanted: Wanted, desk: Desk) -> int:
    """Return an occlusion that blocks a grasp, or FREE; the mask says which ones may."""
    if mask == uint64(0):
        return FREE
    if not wanted.by_hand:
        return _look_at_grasp(scene, grasps, row, mask, 0.0)[0]
    shape = ask_recent(scene, grasps, row, mask, wanted, desk)
    if shape != FREE:
        return shape
    verdict, rest = _look_at_grasp(scene, grasps, row, mask, _length(wanted.approach))
    if verdict == UNDECIDED:
        return ask_hand(scene, grasps, row, rest, wanted, desk)
    if verdict != FREE:
        remember(desk, verdict, BALL)
    return verdict


@compiled
def _open_node(
    scene: Scene,
    tree: BoundingTree,
    bounds: NodeBounds,
    grasps: Grasps,
    node: int,
    mask: int,
    wanted: Wanted,
    taken: IntArray,
    progress: Progress,
) -> None:
    """Reject a node as a whole, or put what is in it on the heap."""
    heap, _, blocked_nodes = progress
    shape, mask = _look_at_node(scene, tree, bounds, node, mask, _length(wanted.approach))
    if shape != FREE:
        blocked_nodes.append((np.int64(node), np.int64(shape)))
    elif tree.left[node] == LEAF:
        end = tree.end[node]
        k = _next_of_run(grasps, mask, tree.begin[node], end, wanted, taken)
        if k < end:
            heapq.heappush(heap, _as_item(grasps, k, mask, end))
    elif mask != uint64(0) or wanted.by_hand or not _is_near_taken(tree, grasps, node, taken, wanted):
        for child in range(tree.left[node], tree.left[node] + 2):
            key = -bounds.best[child]
            heapq.heappush(heap, (key, NODE, np.int64(0), np.int64(child), mask, np.int64(0)))


@compiled
def _start(tree: BoundingTree, bounds: NodeBounds, grasps: Grasps, scene: Scene, wanted: Wanted) -> Progress:
    """Return a heap with the root of the tree and the best grasp beyond it, and nothing blocked yet."""
    zero, none, n = np.int64(0), uint64(0), len(grasps.order)
    every = ~none if len(scene.shapes) > 0 else none
    # Lists need a first element for the compiler to know their type.
    heap, blocked_grasps, blocked_nodes = (
        [(0.0, NODE, zero, zero, none, zero)],
        [(zero, zero)],
        [(zero, zero)],
    )
    heap.pop(), blocked_grasps.pop(), blocked_nodes.pop()
    k = _next_of_run(grasps, every, len(tree.order), n, wanted, np.empty(0, np.int64))
    if k < n:
        heapq.heappush(heap, _as_item(grasps, k, every, n))
    if len(tree.order) > 0:
        heapq.heappush(heap, (-bounds.best[0], NODE, zero, zero, every, zero))
    return heap, blocked_grasps, blocked_nodes


@compiled
def search(
    tree: BoundingTree, bounds: NodeBounds, grasps: Grasps, scene: Scene, wanted: Wanted
) -> tuple[IntArray, int, IntArray]:
    """Find the best grasps that are free and mutually diverse.

    Args:
        tree: over the first grasps; those that it does not cover stand behind them in ``grasps.order``.
        bounds: of its nodes.
        grasps: all of them.
        scene: occlusions.
        wanted: the question.

    Returns:
        Rows found, best first; number of grasps looked at; number blocked by each occlusion, shape (s,).
    """
    progress = _start(tree, bounds, grasps, scene, wanted)
    heap, blocked_grasps, blocked_nodes = progress
    taken, found, desk = np.empty(wanted.number, np.int64), 0, make_desk(MOST_SEGMENTS)
    while len(heap) > 0 and found < wanted.number:
        key, kind, _, item, mask, end = heapq.heappop(heap)
        if -key < wanted.min_quality:
            break
        if kind == NODE:
            _open_node(scene, tree, bounds, grasps, item, mask, wanted, taken[:found], progress)
            continue
        row = grasps.order[item]
        if segments_of(grasps, row) > len(desk.hand):
            desk = make_desk(segments_of(grasps, row))
        shape = _blocker(scene, grasps, row, mask, wanted, desk)
        if shape != FREE:
            blocked_grasps.append((row, np.int64(shape)))
        elif _is_diverse(grasps, row, taken[:found], wanted):
            taken[found] = row
            found += 1
        k = _next_of_run(grasps, mask, item + 1, end, wanted, taken[:found])
        if k < end:
            heapq.heappush(heap, _as_item(grasps, k, mask, end))
    last = taken[found - 1] if found == wanted.number else NOTHING
    considered, blocked = count_looked_at(
        tree, bounds, grasps, len(scene.shapes), wanted.min_quality, last, blocked_grasps, blocked_nodes
    )
    return taken[:found].copy(), considered, blocked
