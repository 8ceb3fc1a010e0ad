"""Baseline: a scrambled Sobol sequence."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.methods.base import MethodSettings, state_int
from mebo_grasp.optimization.methods.common import MethodBase, check_count
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace


class SobolSearch(MethodBase):
    """Points follow one scrambled Sobol sequence, whatever is known.

    The scrambling is drawn at the first proposal and kept in the state as a seed, because a sequence that
    is scrambled anew at each call would lose its balance.
    """

    name = "sobol"

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self._seed: int | None = None
        self._drawn = 0

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the next points of the sequence, shape (count, d)."""
        check_count(count)
        if self._seed is None:
            self._seed = int(rng.integers(2**62))
        sequence = sobol(self._drawn + count, observations.dim, np.random.default_rng(self._seed))
        points = sequence[self._drawn :]
        self._drawn += count
        return points

    def state(self) -> dict[str, Any]:
        """Phase, seed of the scrambling and number of points drawn."""
        return {**super().state(), "seed": self._seed, "drawn": self._drawn}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue the sequence."""
        super().restore(state)
        self._drawn = state_int(state, "drawn")
        self._seed = None if state.get("seed") is None else state_int(state, "seed")
