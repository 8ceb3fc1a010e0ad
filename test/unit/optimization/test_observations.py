import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.observations import Observations


def test_keeps_order_over_many_growths():
    points = np.random.default_rng(0).random((100, 3))
    known = Observations(3)
    for i, u in enumerate(points):
        known.add(u, float(i))
    assert np.array_equal(known.U, points)
    assert np.array_equal(known.y, np.arange(100.0))


def test_views_are_read_only_and_do_not_change_later():
    known = Observations(1)
    known.add([0.5], 1.0)
    view = known.U
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0] = 0.0
    known.add([0.6], 2.0)
    assert view.shape == (1, 1)
    known.add([0.7], 2.0)
    assert known.n == 3


def test_pending_points_are_sorted_by_id_and_leave_when_closed():
    known = Observations(1)
    known.open(7, [0.7])
    known.open(2, [0.2])
    assert np.array_equal(known.pending, [[0.2], [0.7]])
    assert known.close(2)[0] == 0.2
    known.add_failed([0.2])
    assert np.array_equal(known.taken, [[0.2], [0.7]])


@pytest.mark.parametrize("u", [[0.5, 0.5], [1.1], [np.nan]])
def test_points_outside_the_cube_are_refused(u):
    with pytest.raises(InvalidSettingsError, match="unit cube"):
        Observations(1).add(u, 0.0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_must_be_finite(value):
    known = Observations(1)
    with pytest.raises(InvalidSettingsError, match="finite"):
        known.add([0.5], value)
    assert known.n == 0
