"""A balanced tree of boxes over points: what a search can accept or reject without looking inside.

Built by splitting the points at the median of their widest axis until ``leaf_size`` are left. A node
covers the rows ``order[begin:end]``; the children of node k are ``left[k]`` and ``left[k] + 1``, and
``left[k]`` is ``LEAF`` where there are none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.diversity import IntArray

LEAF = -1


class BoundingTree(NamedTuple):
    """The tree as arrays; k nodes over n points.

    Args:
        order: rows of the points, shape (n,).
        begin: first position in ``order``, shape (k,).
        end: behind the last position in ``order``, shape (k,).
        left: index of the left child or ``LEAF``, shape (k,).
        low: least coordinates, shape (k, 3).
        high: greatest coordinates, shape (k, 3).
    """

    order: IntArray
    begin: IntArray
    end: IntArray
    left: IntArray
    low: FloatArray
    high: FloatArray


@borrowing
def _select(boxes: FloatArray, order: IntArray, axis: int, middle: int) -> None:
    """Reorder boxes so that none before ``middle`` lies behind one after it along an axis."""
    low, high = 0, len(order) - 1
    while low < high:
        pivot = boxes[(low + high) // 2, axis] + boxes[(low + high) // 2, 3 + axis]
        i, j = low, high
        while i <= j:
            while boxes[i, axis] + boxes[i, 3 + axis] < pivot:
                i += 1
            while boxes[j, axis] + boxes[j, 3 + axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for k in range(6):
                    boxes[i, k], boxes[j, k] = boxes[j, k], boxes[i, k]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@borrowing
def _fit(boxes: FloatArray, node_low: FloatArray, node_high: FloatArray) -> int:
    """Set the bounds of a node around its boxes; return the node's widest axis."""
    node_low[:], node_high[:] = np.inf, -np.inf
    for i in range(len(boxes)):
        for axis in range(3):
            node_low[axis] = min(node_low[axis], boxes[i, axis])
            node_high[axis] = max(node_high[axis], boxes[i, 3 + axis])
    widest = 0
    for axis in (1, 2):
        if node_high[axis] - node_low[axis] > node_high[widest] - node_low[widest]:
            widest = axis
    return widest


@compiled
def build_tree(low: FloatArray, high: FloatArray, leaf_size: int) -> BoundingTree:
    """Build the tree over n boxes; points are boxes of no size.

    Args:
        low: least coordinates of each box, shape (n, 3), n >= 1.
        high: greatest coordinates, shape (n, 3).
        leaf_size: how many boxes a leaf holds at most.
    """
    n = len(low)
    capacity = 1
    while capacity * leaf_size < n:
        capacity *= 2
    capacity *= 2
    order = np.arange(n)
    begin = np.zeros(capacity, np.int64)
    end = np.zeros(capacity, np.int64)
    left = np.full(capacity, LEAF, np.int64)
    node_low = np.empty((capacity, 3))
    node_high = np.empty((capacity, 3))
    # The boxes are moved along with their rows: to look for them at their first places takes three times as long.
    boxes = np.empty((n, 6))
    boxes[:, :3], boxes[:, 3:] = low, high
    end[0] = n
    count, node = 1, 0
    while node < count:
        b, e = begin[node], end[node]
        axis = _fit(boxes[b:e], node_low[node], node_high[node])
        if e - b > leaf_size:
            middle = (b + e) // 2
            _select(boxes[b:e], order[b:e], axis, middle - b)
            left[node] = count
            begin[count], end[count] = b, middle
            begin[count + 1], end[count + 1] = middle, e
            count += 2
        node += 1
    return BoundingTree(order, begin[:count], end[:count], left[:count], node_low[:count], node_high[:count])
