"""The way between two frames is the product of the transforms along it, wherever it begins."""

import numpy as np
import pytest

from mebo_grasp.errors import InvalidFrameError
from mebo_grasp.grasp import Pose
from mebo_grasp.solutions.frames import FrameTransform, FrameTree


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose.from_rpy(rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3))


def test_a_chain_up_and_down_is_the_product_of_its_transforms() -> None:
    rng = np.random.default_rng(1)
    names = [("world", "base"), ("base", "camera"), ("world", "table"), ("table", "bottle")]
    poses = {child: random_pose(rng) for _, child in names}
    tree = FrameTree(FrameTransform(parent, child, poses[child]) for parent, child in names)
    expected = (
        np.linalg.inv(poses["table"].matrix @ poses["bottle"].matrix) @ poses["base"].matrix @ poses["camera"].matrix
    )
    found = tree.lookup("bottle", "camera")
    assert found is not None
    np.testing.assert_allclose(found.matrix, expected, atol=1e-12)
    back = tree.lookup("camera", "bottle")
    assert back is not None
    np.testing.assert_allclose(back.matrix, np.linalg.inv(expected), atol=1e-12)
    np.testing.assert_array_equal(tree.lookup("base", "base").matrix, np.eye(4))  # type: ignore[union-attr]


def test_no_way_is_none_and_a_circle_ends() -> None:
    one = Pose(np.array([1.0, 0.0, 0.0]))
    tree = FrameTree([FrameTransform("a", "b", one), FrameTransform("b", "a", one)])
    assert tree.lookup("a", "c") is None
    assert tree.lookup("a", "b") is not None


def test_a_later_transform_of_the_same_frame_replaces_the_earlier() -> None:
    first = FrameTransform("world", "camera", Pose(np.array([1.0, 0.0, 0.0])))
    second = FrameTransform("world", "camera", Pose(np.array([2.0, 0.0, 0.0])))
    known = FrameTree([first])
    found = known.updated([second]).lookup("world", "camera")
    assert found is not None
    assert found.position[0] == 2.0
    assert known.lookup("world", "camera").position[0] == 1.0  # type: ignore[union-attr]


@pytest.mark.parametrize(("parent", "child"), [("", "a"), ("a", ""), ("a", "/a")])
def test_two_different_frames_are_needed(parent: str, child: str) -> None:
    with pytest.raises(InvalidFrameError, match="two different frames"):
        FrameTransform(parent, child, Pose.identity())


def test_a_link_takes_no_parent_away() -> None:
    def at(x: float) -> Pose:
        return Pose(np.array([x, 0.0, 0.0]))

    tree = FrameTree([FrameTransform("world", "camera", at(1.0))])
    linked = tree.with_links([FrameTransform("kitchen", "camera", at(0.25))])
    found = linked.lookup("world", "kitchen")
    assert found is not None
    assert found.position[0] == 0.75
    assert tree.lookup("world", "kitchen") is None
