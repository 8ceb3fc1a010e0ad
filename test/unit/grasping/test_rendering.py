"""Pictures: the file is one, hands have their colours, and what is behind the object is hidden."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.rendering import VIEW_DIRECTION, camera, draw, hand_mesh, rank_color, render_grasps
from mebo_grasp.grasping.target_object import TargetObject

BOTTLE = TargetObject.builtin("bottle")
HAND = HandModel.load("icub_left")


def grasp_at(position: np.ndarray) -> Grasp:
    return Grasp(Pose.from_rpy(position, [-np.pi / 2, 0.0, 0.0]), GraspOutcome.GRASPED, 0.1, hand=HAND.name)


def colored(image: np.ndarray) -> int:
    """Return how many pixels are clearly blue, the colour of the best grasp; the object is not."""
    return int(np.sum(image[:, :, 2].astype(int) > image[:, :, 0].astype(int) + 60))


def test_a_hand_before_the_object_is_seen_and_one_behind_it_is_mostly_hidden() -> None:
    big = TargetObject.load("bottle", 4.0)
    direction = VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION)
    color = rank_color(0, 1)
    counts = {}
    for name, side in (("before", 0.5), ("behind", -0.5)):
        mesh = hand_mesh(HAND, grasp_at(side * direction))
        picture = draw(big, [(mesh, color)], (), camera(big, [mesh]))
        counts[name] = colored(picture)
    assert counts["before"] > 300
    assert counts["behind"] < 0.2 * counts["before"]


def test_everything_fits_into_the_picture() -> None:
    mesh = hand_mesh(HAND, grasp_at(np.array([0.0, 0.25, 0.1])))
    picture = draw(BOTTLE, [(mesh, rank_color(0, 1))], (), camera(BOTTLE, [mesh]))
    border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert np.all(border == picture[0, 0])
    assert colored(picture) > 300


def test_the_hand_stands_where_its_tcp_is() -> None:
    here, there = (hand_mesh(HAND, grasp_at(np.array([0.0, y, 0.0]))) for y in (0.1, 0.3))
    np.testing.assert_allclose(
        there.vertices - here.vertices, [[0.0, 0.2, 0.0]] * len(here.vertices), atol=1e-9
    )


def test_the_file_is_a_picture_wider_with_more_grasps(tmp_path: Path) -> None:
    widths = []
    for count in (1, 2):
        path = tmp_path / "new folder" / f"{count}.png"
        render_grasps(
            BOTTLE, HAND, [grasp_at(np.array([0.0, 0.1 + 0.02 * i, 0.0])) for i in range(count)], path
        )
        with Image.open(path) as image:
            widths.append(image.width)
            assert image.format == "PNG"
    assert widths[1] > 2 * widths[0]


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with pytest.raises(InvalidSettingsError, match="no grasp"):
        render_grasps(BOTTLE, HAND, [], tmp_path / "empty.png")
