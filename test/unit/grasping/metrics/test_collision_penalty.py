"""CP = 1 - exp(-lambda n) and Q = epsilon - CP by hand."""

from __future__ import annotations

import math

import pytest

from mebo_grasp.grasping.metrics.collision_penalty import collision_penalty, penalized


def test_the_penalty_by_hand() -> None:
    assert collision_penalty(0, 0.1) == 0.0
    assert collision_penalty(1, 0.1) == pytest.approx(1.0 - math.exp(-0.1), rel=1e-15)
    assert collision_penalty(7, math.log(2.0)) == pytest.approx(1.0 - 0.5**7, rel=1e-12)
    assert collision_penalty(3, 1e-12) == pytest.approx(3e-12, rel=1e-9)


def test_a_deeper_collision_is_worse_and_every_collision_is_worse_than_any_free_pose() -> None:
    values = [penalized(0.0, n, 0.1) for n in range(1, 21)]
    assert values == sorted(values, reverse=True)
    assert all(-1.0 < value < 0.0 for value in values)
    assert penalized(0.02, 0, 0.1) == 0.02
