import numpy as np

from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set

X = np.array([[0.0], [0.1], [0.5], [0.52], [1.0]])
Y = np.array([1.0, 3.0, 2.0, 2.5, 0.5])


def test_walks_from_the_best_down_and_keeps_the_distance():
    assert greedy_diverse_set(X, Y, None, 0.2).tolist() == [1, 3, 4]
    assert greedy_diverse_set(X, Y, 2, 0.2).tolist() == [1, 3]


def test_exact_distance_counts_as_different_and_ties_keep_their_order():
    assert greedy_diverse_set(np.array([[0.0], [0.5]]), np.array([1.0, 1.0]), None, 0.5).tolist() == [0, 1]


def test_no_points_give_an_empty_set():
    assert greedy_diverse_set(np.empty((0, 2)), np.empty(0), 3, 0.1).tolist() == []
