"""Pictures: the file is one, hands have their colours, and what is behind the object is hidden."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel, shapes_in_grasp
from mebo_grasp.grasping.rasterizer import look_at, project, render
from mebo_grasp.grasping.rendering import (
    HAND_COLORS,
    MOST_PANELS,
    OBJECT_COLOR,
    Color,
    caption,
    draw_panel,
    render_grasps,
    shape_mesh,
)
from mebo_grasp.grasping.target_object import TargetObject

BOTTLE = TargetObject.builtin("bottle")
HAND = HandModel.load("icub_left")
BLUE, ORANGE = HAND_COLORS[0], HAND_COLORS[1]
PIXELS = 160
ASIDE = np.array([1.0, 0.0, 0.0])


def grasp_at(position: np.ndarray, contacts: tuple[GraspContact, ...] = ()) -> Grasp:
    """Return a grasp whose palm faces -y, as in the side approach of the left hand."""
    pose = Pose.from_rpy(position, [-np.pi / 2, 0.0, 0.0])
    return Grasp(pose, GraspOutcome.GRASPED, 0.1, hand=HAND.name, contacts=contacts)


def pixels_of(color: Color, image: np.ndarray) -> int:
    """Return how many pixels have the hue of a colour, whatever their brightness; the white ground has none."""
    colors = image.astype(float)
    lengths = np.linalg.norm(colors, axis=2)
    reference = np.array(color) / np.linalg.norm(color)
    cosine = (colors @ reference) / np.maximum(lengths, 1.0)
    return int(np.sum((cosine > 0.99) & (lengths > 20.0) & (image != 255).any(axis=2)))


def two_squares(near: Color, far: Color) -> np.ndarray:
    """Render two squares that face the camera; the order of their triangles must not matter."""
    far_square = np.array([[0.0, -0.1, -0.1], [0.0, 0.1, -0.1], [0.0, 0.1, 0.1], [0.0, -0.1, 0.1]])
    vertices = np.vstack([far_square + 0.1 * ASIDE, far_square])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    colors = np.array([near, near, far, far])
    normals = np.tile(ASIDE, (8, 1))
    camera = look_at(ASIDE, np.zeros(3))
    picture = render(vertices, normals, faces, colors, camera, 0.5, 64)
    np.testing.assert_array_equal(render(vertices, normals, faces[::-1], colors[::-1], camera, 0.5, 64), picture)
    return picture


def test_the_near_surface_hides_the_far_one_in_either_order() -> None:
    picture = two_squares(BLUE, ORANGE)
    assert pixels_of(BLUE, picture) > 500
    assert pixels_of(ORANGE, picture) == 0


def test_a_point_is_drawn_where_the_pinhole_camera_puts_it() -> None:
    camera = look_at(np.array([2.0, 0.0, 0.0]), np.zeros(3))
    # Looking along -x with z up, +y is right. At distance 2 and a full angle of 90 degrees, the picture of
    # 100 pixels is 4 m wide: 1 m is 25 pixels.
    places = project(np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), camera, np.pi / 2, 100)
    np.testing.assert_allclose(places, [[50.0, 50.0], [75.0, 50.0], [50.0, 25.0]], atol=1e-9)


def test_the_empty_picture_is_white() -> None:
    assert np.all(two_squares(BLUE, ORANGE)[0, 0] == 255)


def test_a_hand_before_the_object_is_seen_and_one_behind_it_is_mostly_hidden() -> None:
    big = TargetObject.builtin("bottle", 4.0)
    counts = [
        pixels_of(BLUE, draw_panel("", big, HAND, [grasp_at(side * ASIDE)], [BLUE], ASIDE, 3 * PIXELS).image)
        for side in (0.25, -0.25)
    ]
    assert counts[0] > 500
    assert counts[1] < 0.2 * counts[0]


def test_hands_have_the_colours_given_and_the_object_its_own() -> None:
    grasps = [grasp_at(np.array([0.0, 0.12, 0.05])), grasp_at(np.array([0.0, 0.2, -0.05]))]
    both = draw_panel("", BOTTLE, HAND, grasps, [BLUE, ORANGE], ASIDE, PIXELS).image
    one = draw_panel("", BOTTLE, HAND, grasps[:1], [BLUE], ASIDE, PIXELS).image
    assert pixels_of(BLUE, both) > 150
    assert pixels_of(ORANGE, both) > 150
    assert pixels_of(OBJECT_COLOR, both) > 500
    assert pixels_of(BLUE, one) > 150
    assert pixels_of(ORANGE, one) == 0


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.9, -0.25, 0.55], [0.0, 0.0, 1.0], [-1.0, 1.0, -1.0]])
def test_everything_fits_into_the_picture_and_fills_most_of_it(direction: list[float]) -> None:
    grasps = [grasp_at(np.array([0.0, 0.25, 0.1])), grasp_at(np.array([0.1, 0.1, -0.2]))]
    image = draw_panel("", BOTTLE, HAND, grasps, [BLUE, ORANGE], np.array(direction), PIXELS).image
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert np.all(border == 255)
    rows, columns = np.nonzero((image != 255).any(axis=2))
    assert max(np.ptp(rows), np.ptp(columns)) > 0.8 * PIXELS


def test_a_contact_is_marked_where_it_is_seen() -> None:
    contact = GraspContact("l_index_3_link", np.array([0.0, 0.03283, 0.0]), np.array([0.0, -1.0, 0.0]))
    panel = draw_panel("", BOTTLE, HAND, [grasp_at(np.array([0.0, 0.1, 0.0]), (contact,))], [BLUE], ASIDE, PIXELS)
    column, row = panel.contacts[0]
    # The contact lies on the bottle's right edge as seen from +x: object to the left of it, none to the right.
    left, right = panel.image[round(row), round(column) - 4], panel.image[round(row), round(column) + 4]
    assert pixels_of(OBJECT_COLOR, left.reshape(1, 1, 3)) == 1
    assert pixels_of(OBJECT_COLOR, right.reshape(1, 1, 3)) == 0


def test_the_meshes_of_the_hand_have_the_sizes_of_its_shapes() -> None:
    kinds = set()
    for shape in HAND.link_geometry():
        extents = shape_mesh(shape).bounds
        size, middle = extents[1] - extents[0], extents.mean(axis=0)
        kinds.add(shape.kind)
        if shape.kind == "box":
            np.testing.assert_allclose(size, shape.dims, atol=1e-9)
        else:
            radius, length = shape.dims
            np.testing.assert_allclose(size, [2 * radius, 2 * radius, length + 2 * radius], rtol=0.01)
        np.testing.assert_allclose(middle, 0.0, atol=1e-4)
    assert kinds == {"box", "capsule"}


def test_the_caption_tells_quality_or_why_there_is_none() -> None:
    pose = Pose.identity()
    assert "0.100" in caption(1, grasp_at(np.zeros(3)))
    assert "no contact" in caption(2, Grasp(pose, GraspOutcome.NO_CONTACT, 0.0))


def drawn_size(count: int, path: Path) -> tuple[int, int]:
    render_grasps(BOTTLE, HAND, [grasp_at(np.array([0.0, 0.1 + 0.02 * i, 0.0])) for i in range(count)], path)
    with Image.open(path) as image:
        assert image.format == "PNG"
        image.load()
        return image.width, image.height


def test_one_grasp_is_one_panel_and_two_are_three_side_by_side(tmp_path: Path) -> None:
    one = drawn_size(1, tmp_path / "new" / "folder" / "1.png")
    two = drawn_size(2, tmp_path / "new" / "folder" / "2.png")
    assert two[1] == one[1]
    assert two[0] == pytest.approx(3 * one[0], abs=2)


def test_no_more_than_the_most_panels_are_drawn(tmp_path: Path) -> None:
    # The picture of all and eight single ones make nine panels: five and four in two rows.
    width, height = drawn_size(MOST_PANELS + 3, tmp_path / "many.png")
    one = drawn_size(1, tmp_path / "one.png")
    assert (width, height) == pytest.approx((5 * one[0], 2 * one[1]), abs=4)


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    path = tmp_path / "empty.png"
    with pytest.raises(InvalidSettingsError, match="no grasp of 'bottle'"):
        render_grasps(BOTTLE, HAND, [], path)
    assert not path.exists()


def test_a_posture_of_another_hand_is_drawn_as_that_hand_or_in_the_preshape() -> None:
    right = HandModel.load("icub_right")
    for name, posture, links in (
        ("icub_right", right.preshape, "r_"),
        ("unknown here", right.preshape, "l_"),
        ("unknown here", HandPosture(), "l_"),
    ):
        grasp = replace(grasp_at(np.zeros(3)), hand=name, hand_posture=posture)
        shapes = shapes_in_grasp(HAND, grasp)
        assert {shape.link[:2] for shape in shapes} == {links}
        picture = draw_panel("", BOTTLE, HAND, [grasp], [BLUE], ASIDE, PIXELS).image
        assert pixels_of(BLUE, picture) > 100
