import numpy as np

from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set, slot_values

X = np.array([[0.0], [0.1], [0.5], [0.52], [1.0]])
Y = np.array([1.0, 3.0, 2.0, 2.5, 0.5])


def test_walks_from_the_best_down_and_keeps_the_distance():
    assert greedy_diverse_set(X, Y, None, 0.2).tolist() == [1, 3, 4]
    assert greedy_diverse_set(X, Y, 2, 0.2).tolist() == [1, 3]


def test_exact_distance_counts_as_different_and_ties_keep_their_order():
    assert greedy_diverse_set(np.array([[0.0], [0.5]]), np.array([1.0, 1.0]), None, 0.5).tolist() == [0, 1]


def test_no_points_give_an_empty_set():
    assert greedy_diverse_set(np.empty((0, 2)), np.empty(0), 3, 0.1).tolist() == []


def test_slot_of_a_candidate_is_what_it_would_displace():
    # The set of three is 0.1 (3.0), 0.52 (2.5), 1.0 (0.5).
    candidates = np.array([[0.12], [0.45], [0.75], [1.0]])
    assert slot_values(X, Y, candidates, 3, 0.2).tolist() == [3.0, 2.5, 0.5, 0.5]


def test_slot_of_a_set_that_is_not_full_is_the_lowest_value():
    assert slot_values(X, Y, np.array([[0.75]]), 9, 0.2).tolist() == [0.5]
    assert slot_values(X[:3], Y[:3], np.array([[0.8]]), 9, 0.2).tolist() == [1.0]


def test_a_good_point_that_is_no_part_of_the_set_bars_none_of_its_neighbours():
    # 0.28 (2.9) lies too near to 0.1 (3.0); a point at 0.32 enters the set with any value above the last one's.
    points, values = np.array([[0.1], [0.28], [0.7], [1.0]]), np.array([3.0, 2.9, 1.0, 0.5])
    assert slot_values(points, values, np.array([[0.32]]), 3, 0.2).tolist() == [0.5]
    assert greedy_diverse_set(np.append(points, [[0.32]], axis=0), np.append(values, 0.6), 3, 0.2).tolist() == [0, 2, 4]
