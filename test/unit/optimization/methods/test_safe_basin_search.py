"""The default method under input noise: what it recommends."""

from __future__ import annotations

import numpy as np

from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.methods.safe_basin_search import safest_first
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace


def test_of_equally_good_points_the_one_with_the_least_spread_ranks_first() -> None:
    expected, sd = np.array([0.50, 0.495, 0.47, 0.492]), np.array([0.17, 0.12, 0.01, 0.14])
    assert np.argsort(-safest_first(expected, sd, 0.01)).tolist() == [1, 0, 3, 2]
    assert np.argsort(-safest_first(expected, sd, 0.0)).tolist() == [0, 1, 3, 2]
    assert np.argsort(-safest_first(expected, sd, 1.0))[0] == 2


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
    assert optimizer.solution_set()[0].expected == best.expected
