"""Distances and figures of sets, against numbers computed by hand."""

import math

import numpy as np
import pytest

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.diversity import (
    PoseMetric,
    mean_min_distance,
    mutually_diverse_count,
    qd_value,
    select_diverse,
)


def line(*positions: float) -> tuple[np.ndarray, np.ndarray]:
    points = np.zeros((len(positions), 3))
    points[:, 0] = positions
    return points, np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))


def distances(*positions: float) -> FloatArray:
    values = np.array(positions)
    table: FloatArray = np.abs(values[:, None] - values[None])
    return table


def test_a_quarter_turn_and_three_four_five() -> None:
    a = Pose(np.zeros(3))
    b = Pose.from_rpy([0.03, 0.04, 0.0], [0.0, 0.0, math.pi / 2])
    assert PoseMetric(0.0).distance(a, b) == pytest.approx(0.05, abs=1e-15)
    assert PoseMetric(0.05).distance(a, b) == pytest.approx(math.sqrt(0.05**2 + (0.05 * math.pi / 2) ** 2), abs=1e-15)


def test_opposite_quaternions_are_one_rotation_and_small_turns_are_exact() -> None:
    a = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    b = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, -1.0]))
    c = Pose.from_rpy(np.zeros(3), [1e-9, 0.0, 0.0])
    assert PoseMetric(1.0).distance(a, b) == 0.0
    assert PoseMetric(1.0).distance(a, c) == pytest.approx(1e-9, rel=1e-6)


def test_half_turns_are_the_farthest() -> None:
    a, b = Pose.identity(), Pose.from_rpy(np.zeros(3), [math.pi, 0.0, 0.0])
    assert PoseMetric(1.0).distance(a, b) == pytest.approx(math.pi, abs=1e-12)


def test_pairwise_is_symmetric_and_agrees_with_single_distances() -> None:
    rng = np.random.default_rng(1)
    quaternions = rng.standard_normal((5, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    positions = rng.uniform(-0.1, 0.1, (5, 3))
    metric = PoseMetric(0.08)
    table = metric.pairwise(positions, quaternions)
    for i in range(5):
        for j in range(5):
            single = metric.distance(Pose(positions[i], quaternions[i]), Pose(positions[j], quaternions[j]))
            assert table[i, j] == pytest.approx(single, abs=1e-14)


@pytest.mark.parametrize("weight", [-0.1, math.nan, math.inf])
def test_a_weight_that_is_no_weight_is_refused(weight: float) -> None:
    with pytest.raises(InvalidQueryError, match="rotation_weight"):
        PoseMetric(weight)


def test_greedy_selection_skips_near_grasps_and_breaks_ties_by_order() -> None:
    positions, quaternions = line(0.0, 0.03, 0.05, 0.10, 0.10)
    y = np.array([0.9, 0.8, 0.7, 0.6, 0.6])
    chosen = select_diverse(positions, quaternions, y, 4, 0.05, PoseMetric())
    assert chosen.tolist() == [0, 2, 3]  # 0.03 lies too near to 0; the second of two equal ones too
    assert select_diverse(positions, quaternions, y, 2, 0.0, PoseMetric()).tolist() == [0, 1]
    assert select_diverse(*line(), np.empty(0), 2, 0.1, PoseMetric()).tolist() == []


def test_a_distance_equal_to_the_least_one_is_diverse() -> None:
    positions, quaternions = line(0.0, 0.25)
    chosen = select_diverse(positions, quaternions, np.array([2.0, 1.0]), 2, 0.25, PoseMetric())
    assert chosen.tolist() == [0, 1]
    assert mutually_diverse_count(distances(0.0, 0.25), 0.25) == 2


def test_solutions_linked_by_near_neighbours_are_one() -> None:
    # As in figure 5.3 of the thesis: the ends are far apart, but each is near to the one between.
    assert mutually_diverse_count(distances(0.0, 0.15, 0.30), 0.2) == 1
    assert mutually_diverse_count(distances(0.0, 0.15, 0.40, 0.80), 0.2) == 3
    assert mutually_diverse_count(np.empty((0, 0)), 0.2) == 0


def test_qd_by_hand() -> None:
    D = distances(0.0, 0.1, 0.4)  # nearest neighbours: 0.1, 0.1, 0.3
    y = np.array([0.8, 0.6, 0.4])
    assert mean_min_distance(D) == pytest.approx(0.5 / 3)
    assert qd_value(D, y, 0.05) == pytest.approx(3 * (0.5 / 3) * (0.4 + 0.6))
    assert qd_value(D, y, 0.2) == pytest.approx(2 * (0.5 / 3) * (0.4 + 0.6))


def test_sets_of_none_and_of_one_have_no_diversity() -> None:
    assert mean_min_distance(distances(0.3)) == 0.0
    assert qd_value(distances(0.3), np.array([0.5]), 0.1) == 0.0
    assert qd_value(np.empty((0, 0)), np.empty(0), 0.1) == 0.0
