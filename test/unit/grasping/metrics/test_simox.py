"""Simox's figures by hand and by a second method."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasping.metrics.simox import (
    MOST_FACES,
    ObjectWrenchSpace,
    ball_about_mean,
    object_wrench_space,
    simox_epsilon,
    simox_volume,
    simox_wrenches,
)
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.wrench_space import epsilon


def cube(side: float = 0.1) -> TargetObject:
    return TargetObject.from_mesh(trimesh.creation.box((side, side, side)), "cube")


def test_edges_stand_at_45_degrees_and_torques_are_over_half_the_longest_side() -> None:
    target = TargetObject.from_mesh(trimesh.creation.box((0.1, 0.06, 0.2)), "box")
    wrenches = simox_wrenches([[0.05, 0.0, 0.02]], [[-1.0, 0.0, 0.0]], target)
    assert wrenches.shape == (8, 6)
    np.testing.assert_allclose(wrenches[:, 0], -np.sqrt(0.5), atol=1e-12)
    expected = np.cross(np.array([0.05, 0.0, 0.02]) - target.corner_mean, wrenches[:, :3]) / 0.1
    np.testing.assert_allclose(wrenches[:, 3:], expected, atol=1e-12)


def test_the_ball_stands_about_the_mean_of_all_wrenches() -> None:
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    moved = corners + np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert ball_about_mean(moved) == pytest.approx(1.0, abs=1e-12)
    assert epsilon(moved) == 0.0


def test_the_object_itself_has_the_value_one() -> None:
    target = TargetObject.builtin("bottle")
    unit = object_wrench_space(target, np.random.default_rng(0))
    assert simox_epsilon(unit.wrenches, unit) == pytest.approx(1.0, abs=1e-12)


def test_figures_of_a_small_object_are_those_of_qhull() -> None:
    rng = np.random.default_rng(3)
    mesh = trimesh.convex.convex_hull(rng.normal(size=(14, 3)) * [0.04, 0.03, 0.05])
    target = TargetObject.from_mesh(mesh, "stone")
    unit = object_wrench_space(target, rng)
    assert len(unit.wrenches) == 8 * len(mesh.faces)
    centred = unit.wrenches - unit.wrenches.mean(axis=0)
    hull = ConvexHull(centred)
    assert unit.ball == pytest.approx(float((-hull.equations[:, -1]).min()), rel=1e-9)
    assert unit.volume == pytest.approx(float(hull.volume), rel=1e-9)
    half = unit.wrenches[: len(unit.wrenches) // 2]
    assert simox_volume(half, unit) == pytest.approx(float(ConvexHull(half).volume) / float(hull.volume), rel=1e-9)


def test_of_many_faces_some_are_drawn_and_the_seed_says_which() -> None:
    target = TargetObject.builtin("vase")
    assert len(target.mesh.faces) > MOST_FACES
    spaces = [object_wrench_space(target, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert len(spaces[0].wrenches) == 8 * MOST_FACES
    np.testing.assert_array_equal(spaces[0].wrenches, spaces[1].wrenches)
    assert not np.array_equal(spaces[0].wrenches, spaces[2].wrenches)


def test_the_regular_wrenches_of_a_cube_have_a_volume() -> None:
    unit = object_wrench_space(cube(), np.random.default_rng(0))
    assert unit.ball > 0.1
    assert unit.volume == pytest.approx(ConvexHull(unit.wrenches, qhull_options="QJ").volume, rel=1e-6)


def test_fewer_than_seven_wrenches_and_flat_objects_have_no_figures() -> None:
    unit = ObjectWrenchSpace("sheet", np.zeros((16, 6)))
    with pytest.raises(InvalidObjectError, match="use epsilon"):
        _ = unit.ball
    with pytest.raises(InvalidObjectError, match="use epsilon"):
        _ = unit.volume
    full = object_wrench_space(cube(), np.random.default_rng(0))
    assert (simox_epsilon(np.eye(6), full), simox_volume(np.eye(6), full)) == (0.0, 0.0)
