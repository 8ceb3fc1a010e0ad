"""A surrogate whose smoothness differs from region to region: a treed Gaussian process (UBO paper, section III)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.partition import Node, grow, path_parts
from mebo_grasp.optimization.surrogate.relearning import RelearningSurrogate
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings, sample_chain
from mebo_grasp.optimization.surrogate.treed import LeafPosterior, TreedProcess
from mebo_grasp.optimization.surrogate.weighted_likelihood import Part, WeightedPosterior

MOST_AROUND = 50
"""Observations of a node above a leaf that count in the leaf's hyperparameters: the nearest ones to it. They
only guide what few own observations leave open, and the cost grows with the cube of their number."""


@dataclass(frozen=True)
class TreeSettings:
    """How the cube is divided and the hyperparameters of its regions are learned.

    Args:
        min_leaf: observations of a leaf, at least.
        weight_power: k of the weights along the path to the root; None for infinity.
        sampling: draws of the hyperparameters by slice sampling; None for the most probable ones.
        half_range_signal: whether the signal's standard deviation is half the range of all values in every leaf (the
            UBO paper's worst case, its footnote 4), not learned. A leaf whose few values are alike would else be
            sure that nothing better lies in it. For stationary kernels.

    Raises:
        InvalidSettingsError: a number is out of its range.
    """

    min_leaf: int = 20
    weight_power: float | None = None
    sampling: SamplingSettings | None = None
    half_range_signal: bool = True

    def __post_init__(self) -> None:
        if self.min_leaf < 2:
            raise InvalidSettingsError(f"a leaf needs at least 2 observations, got {self.min_leaf}")
        if self.weight_power is not None and not 0.0 <= self.weight_power < np.inf:
            raise InvalidSettingsError(
                f"the power of the weights must be at least 0, or None for infinity, got {self.weight_power}"
            )


class TreedSurrogate(RelearningSurrogate[TreedProcess]):
    """Grows the tree anew whenever it learns; in between, new observations join the leaves that they lie in.

    Args:
        dim, relearn_period, kernel, noise: see ``RelearningSurrogate``; the kernel is that of every leaf.
        settings: how to divide and to learn.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self,
        dim: int,
        relearn_period: int = 5,
        kernel: Kernel = MATERN52,
        settings: TreeSettings | None = None,
        noise: LogNormalPrior | None = None,
    ) -> None:
        super().__init__(dim, relearn_period, kernel, noise)
        self._settings = settings or TreeSettings()
        self._n_grown = 0
        self._draws = [[self._default]]

    def posterior(self, observations: Observations) -> TreedProcess:
        """Return the posterior given all values with tree and hyperparameters as they are."""
        U, (z, centre, scale) = observations.U, standardize(observations.y)
        tree = self._tree(observations)
        numbers = tree.leaf_numbers(U[self._n_grown :]) if self._n_grown else np.zeros(len(U), dtype=np.int64)
        leaves: list[LeafPosterior] = []
        for number, (leaf, draws) in enumerate(zip(tree.leaves(), self._draws, strict=True)):
            members = np.concatenate([leaf.members, self._n_grown + np.flatnonzero(numbers == number)])
            own_U, own_z = np.ascontiguousarray(U[members]), z[members]
            fitted = [
                replace(
                    GaussianProcess.of_standardized(own_U, own_z, draw, self._kernel),
                    centre=centre, scale=scale,
                )
                for draw in draws
            ]  # fmt: skip
            leaves.append(fitted[0] if len(fitted) == 1 else MixtureProcess.equal(fitted))
        return TreedProcess(tree, tuple(leaves), np.array(U))

    def _tree(self, observations: Observations) -> Node:
        """The tree as it grew when the hyperparameters were learned, shape and all: growing is deterministic."""
        n = self._n_grown
        return grow(observations.U[:n], observations.y[:n], self._settings.min_leaf)

    def _learn(self, observations: Observations, rng: np.random.Generator) -> None:
        before = list(self._tree(observations).leaves())
        self._n_grown = observations.n
        tree = self._tree(observations)
        z = standardize(observations.y)[0]
        draws = []
        for path in tree.paths():
            known = None
            if self._schedule.has_learned:
                overlaps = [_overlap(path[0], other) for other in before]
                known = self._draws[int(np.argmax(overlaps))][-1]
            draws.append(self._draws_for(self._parts(path, observations.U, z), known, self._signal(z), rng))
        self._draws = draws

    def _parts(self, path: tuple[Node, ...], U: FloatArray, z: FloatArray) -> list[Part]:
        middle = 0.5 * (path[0].lower + path[0].upper)
        parts = []
        for number, (members, weight) in enumerate(path_parts(path, self._settings.weight_power)):
            kept = members
            if number and len(members) > MOST_AROUND:
                kept = members[np.argsort(np.linalg.norm(U[members] - middle, axis=1))[:MOST_AROUND]]
            parts.append(Part(np.ascontiguousarray(U[kept]), z[kept], weight))
        return parts

    def _signal(self, z: FloatArray) -> float | None:
        return 0.25 * float(np.ptp(z)) ** 2 if self._settings.half_range_signal else None

    def _draws_for(
        self,
        parts: list[Part],
        known: Hyperparameters | None,
        signal: float | None,
        rng: np.random.Generator,
    ) -> list[Hyperparameters]:
        density = WeightedPosterior(parts, self._kernel, signal, self._noise)
        median = density.prior.mean
        if self._settings.sampling is None:
            return [density.most_probable([median] if known is None else [known.vector, median])]
        start = np.clip(median if known is None else known.vector, density.prior.lower, density.prior.upper)
        return sample_chain(density, start, density.prior.unknown, known is not None, rng, self._settings.sampling)

    def _learned(self) -> dict[str, Any]:
        return {
            "n_grown": self._n_grown,
            "leaves": [[draw.vector.tolist() for draw in draws] for draws in self._draws],
        }

    def _restore_learned(self, state: dict[str, Any]) -> None:
        n_grown, draws = int(state["n_grown"]), [self._draws_of(leaf) for leaf in state["leaves"]]
        if n_grown < 0 or not draws:
            raise RunLogError(
                f"the surrogate's state needs leaves grown on at least 0 values, got {len(draws)} grown on {n_grown}"
            )
        self._n_grown, self._draws = n_grown, draws


def _overlap(a: Node, b: Node) -> float:
    """Volume that two boxes share."""
    sides = np.minimum(a.upper, b.upper) - np.maximum(a.lower, b.lower)
    return float(np.prod(np.maximum(sides, 0.0)))
