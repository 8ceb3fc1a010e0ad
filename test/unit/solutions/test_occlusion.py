"""Shapes at their borders, and what is refused."""

import math

import numpy as np
import pytest

from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import Pose
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Sphere


def inside(shape: object, *point: float) -> bool:
    return bool(Occlusion("o", shape, Pose.identity()).contains(np.array([point]))[0])  # type: ignore[arg-type]


def test_the_border_belongs_to_the_shape() -> None:
    assert inside(Box((0.2, 0.4, 0.6)), 0.1, 0.2, 0.3)
    assert not inside(Box((0.2, 0.4, 0.6)), 0.1, 0.2, 0.3001)
    assert inside(Sphere(0.5), 0.0, 0.3, 0.4)
    assert not inside(Sphere(0.5), 0.001, 0.3, 0.4)
    assert inside(Cylinder(height=0.2, radius=0.5), 0.3, 0.4, -0.1)
    assert not inside(Cylinder(height=0.2, radius=0.5), 0.3, 0.4, -0.1001)
    assert not inside(Cylinder(height=0.2, radius=0.5), 0.31, 0.4, 0.0)


def test_the_cone_has_its_base_below_and_its_apex_above() -> None:
    cone = Cone(height=0.2, radius=0.1)
    assert inside(cone, 0.1, 0.0, -0.1)
    assert inside(cone, 0.0, 0.0, 0.1)
    assert not inside(cone, 0.001, 0.0, 0.1)
    assert inside(cone, 0.049, 0.0, 0.0)
    assert not inside(cone, 0.051, 0.0, 0.0)
    assert not inside(cone, 0.0, 0.0, -0.101)


def test_a_shape_moves_and_turns_with_its_pose() -> None:
    turned = Occlusion("o", Box((0.4, 0.1, 0.1)), Pose.from_rpy([1.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2]))
    points = np.array([[1.0, 0.19, 0.0], [1.19, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert turned.contains(points).tolist() == [True, False, False]


@pytest.mark.parametrize("length", [0.0, -0.1, math.nan, math.inf])
def test_lengths_that_are_no_lengths_are_refused(length: float) -> None:
    for make in (
        lambda: Box((0.1, length, 0.1)),
        lambda: Sphere(length),
        lambda: Cylinder(length, 0.1),
        lambda: Cylinder(0.1, length),
        lambda: Cone(length, 0.1),
        lambda: Cone(0.1, length),
    ):
        with pytest.raises(InvalidOcclusionError, match="finite and above 0"):
            make()


def test_a_box_of_two_lengths_and_an_occlusion_without_name_are_refused() -> None:
    with pytest.raises(InvalidOcclusionError, match="got 2"):
        Box((0.1, 0.1))  # type: ignore[arg-type]
    with pytest.raises(InvalidOcclusionError, match="name"):
        Occlusion("", Sphere(0.1), Pose.identity())
