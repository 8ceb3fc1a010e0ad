import numpy as np
import pytest

from mebo_grasp.optimization.acquisition.cluster_improvement import ClusterExpectedImprovement
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement

CENTROIDS = np.array([[0.0, 0.0], [1.0, 0.0]])


def test_damped_in_proportion_beyond_the_middle():
    acquisition = ClusterExpectedImprovement(0.5, CENTROIDS, 0)
    A = np.array([[0.25, 0.0], [0.8, 0.0], [0.0, 0.0], [1.0, 0.0]])
    mean, sd = np.full(4, 0.4), np.full(4, 0.3)
    plain = ExpectedImprovement(0.5).value(mean, sd)
    assert acquisition.value_at(A, mean, sd) == pytest.approx(plain * [1.0, 0.2 / 0.8, 1.0, 0.0])
