"""Pictures of grasps: object and hand in final posture, drawn offscreen with hidden surfaces hidden."""

from __future__ import annotations

import colorsys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pybullet
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray, Grasp, GraspContact
from mebo_grasp.grasping.hand_model import HandModel, PlacedShape
from mebo_grasp.grasping.target_object import TargetObject

Image = npt.NDArray[np.uint8]
Color = tuple[float, float, float, float]

PANEL_PIXELS = 440
SUPERSAMPLING = 2
"""The renderer does not smooth edges: panels are drawn larger and averaged."""

MOST_PANELS = 8
FIELD_OF_VIEW = 32.0
PICTURE_MARGIN = 1.04
VIEW_DIRECTION = np.array([0.75, 0.45, 0.35])
"""From the object towards the camera, object frame."""

OBJECT_COLOR: Color = (0.82, 0.80, 0.74, 1.0)
CONTACT_COLOR: Color = (0.85, 0.05, 0.05, 1.0)
CONTACT_RADIUS = 0.0025
CONTACT_ARROW = 0.022
ROUND_SECTIONS = 24


def render_grasps(target: TargetObject, hand: HandModel, grasps: Sequence[Grasp], path: str | Path) -> None:
    """Write a PNG with one panel a grasp and, for several, one with all of them.

    Args:
        target: the object.
        hand: the hand of the grasps.
        grasps: best first; at most ``MOST_PANELS`` get a panel of their own.
        path: file to write; replaced when it exists.

    Raises:
        InvalidSettingsError: there is no grasp to draw.
    """
    if not grasps:
        raise InvalidSettingsError("there is no grasp to draw")
    colors = [rank_color(rank, len(grasps)) for rank in range(len(grasps))]
    shown = list(zip(grasps, colors, strict=True))[:MOST_PANELS]
    hands = [hand_mesh(hand, grasp) for grasp, _ in shown]
    view = camera(target, hands)
    panels = []
    if len(shown) > 1:
        pieces = [(mesh, color) for mesh, (_, color) in zip(hands, shown, strict=True)]
        panels.append((f"{target.object_id}: {len(shown)} diverse grasps", draw(target, pieces, (), view)))
    for rank, (mesh, (grasp, color)) in enumerate(zip(hands, shown, strict=True), start=1):
        title = f"{rank}: epsilon {grasp.epsilon:.3f}, {len(grasp.contacts)} contacts"
        panels.append((title, draw(target, [(mesh, color)], grasp.contacts, view)))
    compose(panels, Path(path))


def rank_color(rank: int, count: int) -> Color:
    """Return a colour of its own for each of ``count`` grasps."""
    r, g, b = colorsys.hsv_to_rgb(0.58 + rank / max(count, 1), 0.65, 0.9)
    return (r, g, b, 1.0)


def hand_mesh(hand: HandModel, grasp: Grasp) -> trimesh.Trimesh:
    """Return the hand in the grasp's final posture, object frame."""
    posture = grasp.hand_posture if grasp.hand_posture.names else None
    pieces = []
    for shape in hand.link_geometry(posture):
        piece = shape_mesh(shape)
        piece.apply_transform((grasp.T_object_tcp @ shape.T_tcp_shape).matrix)
        pieces.append(piece)
    return trimesh.util.concatenate(pieces)


def shape_mesh(shape: PlacedShape) -> trimesh.Trimesh:
    """Return a link's shape as a mesh in its own frame."""
    if shape.vertices is not None:
        return trimesh.convex.convex_hull(shape.vertices)
    if shape.kind == "box":
        return trimesh.creation.box(extents=shape.dims)
    if shape.kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=3, radius=shape.dims[0])
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(radius=shape.dims[0], height=shape.dims[1], sections=ROUND_SECTIONS)
    capsule = trimesh.creation.capsule(
        radius=shape.dims[0], height=shape.dims[1], count=(ROUND_SECTIONS,) * 2
    )
    capsule.apply_translation([0.0, 0.0, -float(capsule.bounds[:, 2].mean())])
    return capsule


class Camera:
    """Where a picture is taken from.

    Args:
        points: what must fit into the picture, shape (n, 3), object frame, metres.
    """

    def __init__(self, points: FloatArray) -> None:
        backward = VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION)
        right = np.cross([0.0, 0.0, 1.0], backward)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(backward, right), backward])
        seen = points @ axes.T
        middle, half = (seen.max(axis=0) + seen.min(axis=0)) / 2.0, np.ptp(seen, axis=0) / 2.0
        # The nearest points look largest: the frame must fit in front of them, not in the middle.
        distance = PICTURE_MARGIN * half[:2].max() / np.tan(np.radians(FIELD_OF_VIEW / 2.0)) + half[2]
        focus = middle @ axes
        self.view = pybullet.computeViewMatrix(
            (focus + distance * backward).tolist(), focus.tolist(), [0.0, 0.0, 1.0]
        )
        self.projection = pybullet.computeProjectionMatrixFOV(
            FIELD_OF_VIEW, 1.0, 0.5 * (distance - half[2]), distance + 2.0 * half[2]
        )


def camera(target: TargetObject, hands: Sequence[trimesh.Trimesh]) -> Camera:
    """Return a camera that sees the object and every hand."""
    return Camera(np.concatenate([target.mesh.vertices, *(mesh.vertices for mesh in hands)]))


def draw(
    target: TargetObject,
    hands: Sequence[tuple[trimesh.Trimesh, Color]],
    contacts: Sequence[GraspContact],
    view: Camera,
) -> Image:
    """Return a square picture, shape (n, n, 3), of the object, hands and contact normals."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        with tempfile.TemporaryDirectory() as folder:
            pieces = [(target.mesh, OBJECT_COLOR), *hands]
            pieces += [(contact_mesh(contact), CONTACT_COLOR) for contact in contacts]
            for number, (mesh, color) in enumerate(pieces):
                _add_mesh(client, mesh, color, Path(folder) / f"{number}.obj")
            size = PANEL_PIXELS * SUPERSAMPLING
            _, _, pixels, _, _ = pybullet.getCameraImage(
                size,
                size,
                view.view,
                view.projection,
                lightDirection=[0.5, 1.0, 1.4],
                lightAmbientCoeff=0.55,
                lightDiffuseCoeff=0.5,
                lightSpecularCoeff=0.1,
                shadow=0,
                renderer=pybullet.ER_TINY_RENDERER,
                physicsClientId=client,
            )
    finally:
        pybullet.disconnect(physicsClientId=client)
    image = np.reshape(np.asarray(pixels, dtype=np.float64), (size, size, 4))[:, :, :3]
    blocks = image.reshape(PANEL_PIXELS, SUPERSAMPLING, PANEL_PIXELS, SUPERSAMPLING, 3)
    smooth: Image = blocks.mean(axis=(1, 3)).astype(np.uint8)
    return smooth


def _add_mesh(client: int, mesh: trimesh.Trimesh, color: Color, path: Path) -> None:
    # Bullet takes vertex normals from the file only; faces keep corners of their own, so edges stay sharp.
    mesh.export(path, include_normals=True)
    shape = pybullet.createVisualShape(
        pybullet.GEOM_MESH, fileName=str(path), rgbaColor=color, physicsClientId=client
    )
    pybullet.createMultiBody(baseVisualShapeIndex=shape, physicsClientId=client)


def contact_mesh(contact: GraspContact) -> trimesh.Trimesh:
    """Return a needle along the contact normal that ends in the contact point."""
    start = contact.position - CONTACT_ARROW * contact.normal
    needle = trimesh.creation.cylinder(
        radius=CONTACT_RADIUS / 3.0, segment=[start, contact.position], sections=8
    )
    tip = trimesh.creation.icosphere(subdivisions=2, radius=CONTACT_RADIUS)
    tip.apply_translation(contact.position)
    return trimesh.util.concatenate([needle, tip])


def compose(panels: Sequence[tuple[str, Image]], path: Path) -> None:
    """Write panels with their titles side by side."""
    columns = min(len(panels), 5) if len(panels) <= 5 else -(-len(panels) // 2)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.0 * columns, 3.25 * rows), dpi=140, layout="constrained")
    FigureCanvasAgg(figure)
    for number, (title, image) in enumerate(panels, start=1):
        axes = figure.add_subplot(rows, columns, number)
        axes.imshow(image)
        axes.set_title(title, fontsize=9)
        axes.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png")
