"""How the unit cube is divided among Gaussian processes: recursive axis-parallel splits (UBO paper, section III-B).

A node is split at a coordinate of one of its observations so that the sum of squared deviations from the mean
falls most (eq. 4 and 5, times the number of observations, which changes no choice). The observation at which a
split lies belongs to both sides, so that neither is uncertain there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

IndexArray = npt.NDArray[np.int64]

CLOSEST_TO_BOUND = 0.01
"""A split keeps at least this distance, in sides of the cube, from the bounds of its node."""


@dataclass(frozen=True, eq=False)
class Node:
    """A box of the cube with its observations.

    Args:
        lower, upper: corners, shape (d,).
        members: indices of the observations that its surrogate may use.
        depth: 0 at the root.
        axis: of the split; -1 for a leaf.
        threshold: points with a coordinate above it belong to ``right``.
        left, right: the two parts; None for a leaf.
    """

    lower: FloatArray
    upper: FloatArray
    members: IndexArray
    depth: int
    axis: int = -1
    threshold: float = 0.0
    left: Node | None = None
    right: Node | None = None

    def leaves(self) -> Iterator[Node]:
        """The leaves below, from left to right."""
        if self.left is None or self.right is None:
            yield self
        else:
            yield from self.left.leaves()
            yield from self.right.leaves()

    def paths(self) -> Iterator[tuple[Node, ...]]:
        """For each leaf the nodes from it up to this one."""
        if self.left is None or self.right is None:
            yield (self,)
        else:
            for part in (self.left, self.right):
                for path in part.paths():
                    yield (*path, self)

    def leaf_at(self, u: FloatArray) -> Node:
        """The leaf that a point, shape (d,), lies in."""
        node = self
        while node.left is not None and node.right is not None:
            node = node.right if u[node.axis] > node.threshold else node.left
        return node

    def leaf_numbers(self, A: FloatArray) -> IndexArray:
        """Number of the leaf, in the order of ``leaves``, that each of the points A, shape (m, d), lies in."""
        numbers = np.empty(len(A), dtype=np.int64)
        self._number(A, np.arange(len(A)), numbers, 0)
        return numbers

    def _number(self, A: FloatArray, rows: IndexArray, numbers: IndexArray, first: int) -> int:
        """Number the leaves below from ``first`` on; return the next free number."""
        if self.left is None or self.right is None:
            numbers[rows] = first
            return first + 1
        above = A[rows, self.axis] > self.threshold
        first = self.left._number(A, rows[~above], numbers, first)
        return self.right._number(A, rows[above], numbers, first)


def split_gains(values: FloatArray) -> FloatArray:
    """Fall of the sum of squared deviations when sorted values are split at each one, shape (n,).

    The value at the split counts on both sides, so the fall may be negative.
    """
    values = values - np.mean(values)
    count = np.arange(1.0, len(values) + 1.0)
    left = np.cumsum(values**2) - np.cumsum(values) ** 2 / count
    backwards = values[::-1]
    right = (np.cumsum(backwards**2) - np.cumsum(backwards) ** 2 / count)[::-1]
    gains: FloatArray = np.sum(values**2) - left - right
    return gains


def grow(U: FloatArray, y: FloatArray, min_leaf: int) -> Node:
    """Split the cube as long as that reduces the uncertainty and leaves every part enough observations.

    Args:
        U: points in the unit cube, shape (n, d).
        y: values, shape (n,).
        min_leaf: observations of a leaf, at least.
    """
    dim = U.shape[1]
    return _grown(Node(np.zeros(dim), np.ones(dim), np.arange(len(y)), 0), U, y, min_leaf)


def _grown(node: Node, U: FloatArray, y: FloatArray, min_leaf: int) -> Node:
    split = _best_split(node, U, y, min_leaf)
    if split is None:
        return node
    axis, threshold = split
    upper, lower = node.upper.copy(), node.lower.copy()
    upper[axis] = lower[axis] = threshold
    coordinates = U[node.members, axis]
    left = Node(node.lower, upper, node.members[coordinates <= threshold], node.depth + 1)
    right = Node(lower, node.upper, node.members[coordinates >= threshold], node.depth + 1)
    parts = [_grown(part, U, y, min_leaf) for part in (left, right)]
    return Node(node.lower, node.upper, node.members, node.depth, axis, threshold, *parts)


def _best_split(node: Node, U: FloatArray, y: FloatArray, min_leaf: int) -> tuple[int, float] | None:
    n = len(node.members)
    if n < 2 * min_leaf:
        return None
    best_gain, best = 0.0, None
    for axis in range(U.shape[1]):
        order = node.members[np.argsort(U[node.members, axis], kind="stable")]
        at = U[order, axis]
        position = np.arange(n)
        allowed = (position + 1 >= min_leaf) & (n - position >= min_leaf)
        allowed &= (at >= node.lower[axis] + CLOSEST_TO_BOUND) & (at <= node.upper[axis] - CLOSEST_TO_BOUND)
        # Where two coordinates coincide the split would not lie between observations.
        allowed[1:] &= at[1:] > at[:-1]
        allowed[:-1] &= at[:-1] < at[1:]
        gains = np.where(allowed, split_gains(y[order]), -np.inf)
        i = int(np.argmax(gains))
        if gains[i] > best_gain:
            best_gain, best = float(gains[i]), (axis, float(at[i]))
    return best


def path_parts(path: tuple[Node, ...], power: float | None) -> list[tuple[IndexArray, float]]:
    """What a leaf's hyperparameters are learned from (paper, eq. 7 to 9).

    Args:
        path: nodes from the leaf up to the root.
        power: k; None for infinity.

    Returns:
        Pairs of observations and the weight (2 / (1 + depth difference))^k of their log likelihood: the leaf's own,
        then for each node above those that no node before it on the path holds. With k infinite the own ones alone
        count, once.
    """
    if power is None:
        return [(path[0].members, 1.0)]
    parts = [(path[0].members, 2.0**power)]
    for below, node in pairwise(path):
        rest = np.setdiff1d(node.members, below.members, assume_unique=True)
        parts.append((rest, (2.0 / (1.0 + path[0].depth - node.depth)) ** power))
    return parts
