import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.search_space import SearchSpace

SPACE = SearchSpace(("x", "angle"), np.array([-50.0, 0.0]), np.array([3.0, 1.5]), ("mm", "rad"))


def test_corners_map_exactly_and_back():
    assert np.array_equal(SPACE.from_unit([0.0, 1.0]), [-50.0, 1.5])
    assert np.array_equal(SPACE.to_unit([-50.0, 1.5]), [0.0, 1.0])
    assert np.allclose(SPACE.to_unit([[-23.5, 0.75]]), [[0.5, 0.5]], rtol=0, atol=1e-15)


def test_contains_knows_bounds_shape_and_finiteness():
    assert SPACE.contains([3.0, 0.0])
    assert not SPACE.contains([3.0000001, 0.0])
    assert not SPACE.contains([0.0])
    assert not SPACE.contains([np.nan, 0.0])


def test_bounds_cannot_be_changed_from_outside():
    lower = np.array([0.0])
    space = SearchSpace(("x",), lower, np.ones(1))
    lower[0] = -5.0
    assert space.lower[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        space.lower[0] = 2.0


@pytest.mark.parametrize(
    ("names", "lower", "upper", "units", "message"),
    [
        ((), [], [], (), "at least one dimension"),
        (("x", "x"), [0, 0], [1, 1], (), "distinct"),
        (("",), [0], [1], (), "not empty"),
        (("x",), [0, 0], [1, 1], (), "shape"),
        (("x",), [1.0], [1.0], (), "below its upper bound"),
        (("x",), [np.nan], [1.0], (), "finite"),
        (("x",), [-1e308], [1.7e308], (), "finite"),
        (("x",), [0], [1], ("m", "rad"), "one unit a dimension"),
    ],
)
def test_bad_boxes_are_refused(names, lower, upper, units, message):
    with pytest.raises(InvalidSettingsError, match=message):
        SearchSpace(names, lower, upper, units)


def test_distances_count_by_their_weights():
    lower, upper, weights = np.array([0.0, -1.0]), np.array([0.2, 1.0]), np.array([1.0, 0.05])
    space = SearchSpace(("x", "roll"), lower, upper, distance_weights=weights)
    np.testing.assert_allclose(space.weighted_sides, [0.2, 0.1])
    np.testing.assert_array_equal(SPACE.weighted_sides, SPACE.upper - SPACE.lower)


@pytest.mark.parametrize("weights", [[1.0], [1.0, -0.1], [1.0, np.nan], [0.0, 0.0], 1.0])
def test_bad_weights_are_refused(weights):
    with pytest.raises(InvalidSettingsError, match="weight"):
        SearchSpace(("x", "y"), np.zeros(2), np.ones(2), distance_weights=np.array(weights))
