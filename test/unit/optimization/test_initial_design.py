import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.initial_design import best_candidate, latin_hypercube, sobol


@pytest.mark.parametrize("n", [1, 2, 25])
def test_latin_hypercube_has_one_point_in_each_cell(n):
    design = latin_hypercube(n, 4, np.random.default_rng(1))
    cells = np.sort(np.floor(design * n).astype(int), axis=0)
    assert np.array_equal(cells, np.tile(np.arange(n)[:, None], 4))


def test_sobol_prefix_of_a_power_of_two_is_stratified():
    design = sobol(16, 2, np.random.default_rng(1))
    for q in range(2):
        assert sorted(np.floor(design[:, q] * 16).astype(int)) == list(range(16))


@pytest.mark.parametrize("draw", [latin_hypercube, sobol])
def test_depends_on_the_generators_state_and_nothing_else(draw):
    first = draw(9, 3, np.random.default_rng(5))
    restored = np.random.Generator(np.random.PCG64(999))  # another seed sequence …
    restored.bit_generator.state = np.random.default_rng(5).bit_generator.state  # … in the same state
    assert np.array_equal(first, draw(9, 3, restored))
    assert not np.array_equal(first, draw(9, 3, np.random.default_rng(6)))


@pytest.mark.parametrize("draw", [latin_hypercube, sobol])
def test_empty_and_impossible_designs(draw):
    assert draw(0, 2, np.random.default_rng(0)).shape == (0, 2)
    with pytest.raises(InvalidSettingsError):
        draw(-1, 2, np.random.default_rng(0))
    with pytest.raises(InvalidSettingsError):
        draw(3, 0, np.random.default_rng(0))


def test_best_candidate_goes_to_the_largest_gap():
    # Only the upper right quarter is free; its farthest corner is 0.5 from the nearest point of the rest.
    taken = np.array([(a, b) for a in np.linspace(0, 1, 9) for b in np.linspace(0, 1, 9) if a <= 0.5 or b <= 0.5])
    picks = np.array([best_candidate(taken, np.random.default_rng(seed)) for seed in range(20)])
    assert np.all(picks > 0.5)
    assert np.mean(picks) > 0.8
