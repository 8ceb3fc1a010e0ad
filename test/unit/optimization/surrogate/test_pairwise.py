import numpy as np

from mebo_grasp.optimization.surrogate import pairwise


def test_exponential_matches_numpy_to_rounding():
    x = -np.concatenate([np.linspace(0.0, 60.0, 20011), np.geomspace(1e-15, 707.0, 3000), [0.0]])
    result = x.copy()
    pairwise.exp_in_place(result, np.empty_like(x))
    assert np.max(np.abs(result / np.exp(x) - 1.0)) < 5e-16


def test_exponential_of_huge_arguments_is_tiny_and_not_garbage():
    x = np.array([-709.0, -1e4, -1e300])
    pairwise.exp_in_place(x, np.empty_like(x))
    assert np.all((x >= 0.0) & (x < 1e-300))
