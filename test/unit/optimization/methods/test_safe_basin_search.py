"""The default method under input noise: what it recommends."""

from __future__ import annotations

import numpy as np
import pytest

from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.methods.safe_basin_search import CAUTION
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace


def test_a_hill_is_recommended_before_the_end_of_a_slope_that_is_hardly_better() -> None:
    """With noise of 0.02 the slope's end has 0.994 ± 0.024, the hill 0.990 ± 0.007."""

    def landscape(x: float) -> float:
        return max(1.01 - 2.0 * x, 0.995 - 12.0 * (x - 0.75) ** 2)

    settings = OptimizerSettings(budget=30, n_initial=20, safe=True, input_noise=InputNoise((0.02,)))
    optimizer = Optimizer(SearchSpace(("x",), np.zeros(1), np.ones(1)), "basin_search", settings, 0)
    while not optimizer.finished:
        for trial in optimizer.ask():
            optimizer.tell(trial.id, landscape(float(trial.x[0])))
    best = optimizer.safe_incumbent
    assert best is not None
    assert abs(best.x[0] - 0.75) < 0.03
    assert best.sd < 0.01
    first, *others = optimizer.solution_set()
    assert (first.x == best.x).all()
    ranks = [solution.expected - CAUTION * solution.sd for solution in (first, *others)]
    assert ranks == pytest.approx(sorted(ranks, reverse=True))
