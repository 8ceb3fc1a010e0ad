"""A posterior that is another Gaussian process in each region of the cube (UBO paper, section III-A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.partition import Node

LeafPosterior = GaussianProcess | MixtureProcess


@dataclass(frozen=True, eq=False)
class TreedProcess:
    """Predicts a point by the leaf that it lies in; immutable.

    Args:
        tree: the partition.
        leaves: posterior of each leaf in the order of ``tree.leaves()``, from its own observations; all
            with the centre and the scale of all values.
        U: all observed points, shape (n, d).
    """

    tree: Node
    leaves: tuple[LeafPosterior, ...]
    U: FloatArray

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return int(self.U.shape[1])

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.U)

    @property
    def centre(self) -> float:
        """Mean of the observed values."""
        return self.leaves[0].centre

    @property
    def scale(self) -> float:
        """Standard deviation of the observed values."""
        return self.leaves[0].scale

    @cached_property
    def _of_leaf(self) -> dict[Node, LeafPosterior]:
        return dict(zip(self.tree.leaves(), self.leaves, strict=True))

    def _shares(self) -> FloatArray:
        """Share of the cube's volume that each leaf has, shape (number of leaves,)."""
        return np.array([np.prod(leaf.upper - leaf.lower) for leaf in self.tree.leaves()])

    @property
    def noise_sd(self) -> float:
        """Root mean square of the leaves' noise by volume, units of y."""
        return float(np.sqrt(self._shares() @ np.array([leaf.noise_sd**2 for leaf in self.leaves])))

    @property
    def lengthscales(self) -> FloatArray:
        """Geometric mean of the leaves' lengthscales by volume, shape (d,)."""
        return np.exp(self._shares() @ np.log([leaf.lengthscales for leaf in self.leaves]))

    def _by_leaf(
        self, A: FloatArray, evaluate: Callable[[LeafPosterior, FloatArray], tuple[FloatArray, ...]]
    ) -> tuple[FloatArray, ...]:
        """Evaluate each point of A, shape (m, d), in its leaf and put the parts together in the order of A."""
        if len(self.leaves) == 1:
            return evaluate(self.leaves[0], A)
        if len(A) == 1:
            # Searches for a summit ask point by point, and sorting into leaves would cost as much as the answer.
            return evaluate(self._of_leaf[self.tree.leaf_at(A[0])], A)
        numbers = self.tree.leaf_numbers(A)
        parts: list[FloatArray] = []
        for number in np.unique(numbers) if len(A) else (0,):
            rows = numbers == number
            found = evaluate(self.leaves[number], np.ascontiguousarray(A[rows]))
            parts = parts or [np.empty((len(A), *part.shape[1:])) for part in found]
            for whole, part in zip(parts, found, strict=True):
                whole[rows] = part
        return tuple(parts)

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, shape (m,) each, at A, shape (m, d)."""
        mean, sd = self._by_leaf(A, lambda leaf, own: leaf.predict(own))
        return mean, sd

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Mean at A, shape (m, d). Returns shape (m,)."""
        return self._by_leaf(A, lambda leaf, own: (leaf.predict_mean(own),))[0]

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of the mean at A, shape (m, d); across a split the mean jumps."""
        return self._by_leaf(A, lambda leaf, own: (leaf.mean_gradient(own),))[0]

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean and standard deviation with their gradients; see ``GaussianProcess``."""
        mean, sd, d_mean, d_sd = self._by_leaf(A, lambda leaf, own: leaf.predict_with_gradients(own))
        return mean, sd, d_mean, d_sd

    def condition_on(self, A: FloatArray, values: FloatArray) -> TreedProcess:
        """With further points A, shape (m, d), and values, shape (m,), each in its leaf."""
        numbers = self.tree.leaf_numbers(A)
        leaves = list(self.leaves)
        for number in np.unique(numbers):
            rows = numbers == number
            leaves[number] = leaves[number].condition_on(A[rows], np.asarray(values)[rows])
        return replace(self, leaves=tuple(leaves), U=np.concatenate([self.U, A]))

    def sample_path(self, rng: np.random.Generator, n_features: int = 1024) -> Callable[[FloatArray], FloatArray]:
        """Draw one function, independently in each leaf."""
        paths = [leaf.sample_path(rng, n_features) for leaf in self.leaves]

        def path(A: FloatArray) -> FloatArray:
            numbers = self.tree.leaf_numbers(A)
            values = np.empty(len(A))
            for number in np.unique(numbers):
                rows = numbers == number
                values[rows] = paths[number](A[rows])
            return values

        return path
