"""Baseline: uniform random points."""

from __future__ import annotations

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.common import MethodBase, check_count
from mebo_grasp.optimization.observations import Observations


class RandomSearch(MethodBase):
    """Each point is drawn uniformly from the box, whatever is known."""

    name = "random"

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return uniform points, shape (count, d)."""
        check_count(count)
        return rng.random((count, observations.dim))
