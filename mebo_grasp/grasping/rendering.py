"""Pictures of an object with grasping hands in their final postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, GraspOutcome
from mebo_grasp.grasping.hand_model import HandModel, PlacedShape, shapes_in_grasp
from mebo_grasp.grasping.rasterizer import look_at, project, render
from mebo_grasp.grasping.target_object import TargetObject

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]
Color = tuple[float, float, float]

OBJECT_COLOR: Color = (0.86, 0.83, 0.76)
CONTACT_COLOR: Color = (0.90, 0.05, 0.05)
HAND_COLORS: tuple[Color, ...] = (
    (0.22, 0.49, 0.72),
    (0.95, 0.55, 0.15),
    (0.30, 0.64, 0.32),
    (0.60, 0.40, 0.70),
    (0.62, 0.42, 0.34),
    (0.90, 0.50, 0.74),
    (0.72, 0.70, 0.20),
    (0.20, 0.70, 0.76),
)
PANEL_PIXELS = 460
PANEL_INCHES = 3.4
FIELD_OF_VIEW = np.radians(24.0)
FILLED_SHARE = 0.94
SMOOTH_ANGLE = np.radians(28.0)
MOST_PANELS = 8
ARC_SECTIONS = 24


class Triangles:
    """Coloured triangles of a scene, collected body by body."""

    def __init__(self) -> None:
        self._vertices: list[FloatArray] = []
        self._normals: list[FloatArray] = []
        self._faces: list[IntArray] = []
        self._colors: list[FloatArray] = []
        self._count = 0

    def add(self, mesh: trimesh.Trimesh, color: Color, T: FloatArray | None = None) -> None:
        """Add a mesh, moved by ``T`` (4, 4)."""
        vertices, normals = np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
        if T is not None:
            vertices, normals = vertices @ T[:3, :3].T + T[:3, 3], normals @ T[:3, :3].T
        self._vertices.append(vertices)
        self._normals.append(normals)
        self._faces.append(np.asarray(mesh.faces, dtype=np.int64) + self._count)
        self._colors.append(np.tile(color, (len(mesh.faces), 1)))
        self._count += len(vertices)

    def points(self) -> FloatArray:
        """Return all vertices, shape (n, 3)."""
        return np.vstack(self._vertices)

    def camera(self, direction: FloatArray) -> FloatArray:
        """Return the pose of a camera that sees the whole scene from a direction, as large as it gets."""
        points = self.points()
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        T = look_at(middle + direction / np.linalg.norm(direction), middle)
        local = (points - middle) @ T[:3, :3]
        middle = middle + T[:3, :3] @ np.append((local[:, :2].min(axis=0) + local[:, :2].max(axis=0)) / 2.0, 0.0)
        local = (points - middle) @ T[:3, :3]
        # A point is in the picture if its sideways offset is below tan(half angle) times its distance.
        spread = np.abs(local[:, :2]).max(axis=1) / (np.tan(FIELD_OF_VIEW / 2.0) * FILLED_SHARE)
        return look_at(middle + T[:3, 2] * float((spread + local[:, 2]).max()), middle)

    def picture(self, camera: FloatArray, pixels: int) -> Image:
        """Render the scene as seen by a camera, shape (pixels, pixels, 3)."""
        return render(
            self.points(),
            np.vstack(self._normals),
            np.vstack(self._faces),
            np.vstack(self._colors),
            camera,
            FIELD_OF_VIEW,
            pixels,
        )


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture with the places of its contacts in it.

    Args:
        title: the line above.
        image: shape (pixels, pixels, 3).
        contacts: (n, 2) column and row of each contact.
    """

    title: str
    image: Image
    contacts: FloatArray


def shape_mesh(shape: PlacedShape) -> trimesh.Trimesh:
    """Return a triangle mesh of a hand's shape, in the shape's own frame."""
    if shape.kind == "box":
        return _faceted(trimesh.creation.box(shape.dims))
    if shape.kind == "sphere":
        return trimesh.creation.icosphere(3, shape.dims[0])
    if shape.kind == "capsule":
        radius, length = shape.dims
        capsule = trimesh.creation.capsule(length, radius, count=[ARC_SECTIONS, ARC_SECTIONS])
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return capsule
    if shape.kind == "cylinder":
        return _faceted(trimesh.creation.cylinder(*shape.dims, sections=ARC_SECTIONS))
    return _faceted(trimesh.PointCloud(np.asarray(shape.vertices)).convex_hull)


def _faceted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh with its sharp edges kept sharp when shaded."""
    return trimesh.graph.smooth_shade(mesh, angle=SMOOTH_ANGLE)


def _add_hand(scene: Triangles, hand: HandModel, grasp: Grasp, color: Color) -> None:
    T = grasp.T_object_tcp.matrix
    for shape in shapes_in_grasp(hand, grasp):
        scene.add(shape_mesh(shape), color, T @ shape.T_tcp_shape.matrix)


def view_direction(hand: HandModel, grasp: Grasp) -> FloatArray:
    """Return a direction to look from that shows palm, fingers and object: from the side of the fingertips."""
    R = grasp.T_object_tcp.rotation.as_matrix()
    palm, fingers = R @ hand.palm_normal, R[:, 0]
    direction: FloatArray = fingers * 0.9 - palm * 0.25 + np.array([0.0, 0.0, 0.55])
    return direction


def draw_panel(
    title: str,
    target: TargetObject,
    hand: HandModel,
    grasps: Sequence[Grasp],
    colors: Sequence[Color],
    direction: FloatArray,
    pixels: int = PANEL_PIXELS,
) -> Panel:
    """Render an object with some hands, seen from a direction."""
    scene = Triangles()
    scene.add(_faceted(target.mesh), OBJECT_COLOR)
    for grasp, color in zip(grasps, colors, strict=True):
        _add_hand(scene, hand, grasp, color)
    camera = scene.camera(direction)
    contacts = [contact.position for grasp in grasps for contact in grasp.contacts]
    places = project(np.array(contacts).reshape(-1, 3), camera, FIELD_OF_VIEW, pixels)
    return Panel(title, scene.picture(camera, pixels), places)


def caption(number: int, grasp: Grasp) -> str:
    """Return the line above a panel."""
    if grasp.outcome is not GraspOutcome.GRASPED:
        return f"{number}: {grasp.outcome.name.lower().replace('_', ' ')}"
    return f"{number}: quality {grasp.quality:.3f}, {len(grasp.contacts)} contacts"


def render_grasps(target: TargetObject, hand: HandModel, grasps: Sequence[Grasp], path: str | Path) -> None:
    """Write a picture: all grasps together, then one panel a grasp (at most ``MOST_PANELS``), best first.

    Args:
        target: the object.
        hand: the hand of all grasps.
        grasps: grasps with their final postures, at least one.
        path: file to write; its suffix says the format (png). Folders that do not exist are made.

    Raises:
        InvalidSettingsError: there is no grasp to draw.
    """
    if not grasps:
        raise InvalidSettingsError(f"no grasp of '{target.object_id}' to draw for '{path}'; give at least one")
    shown = list(grasps)[:MOST_PANELS]
    colors = [HAND_COLORS[i % len(HAND_COLORS)] for i in range(len(shown))]
    panels: list[Panel] = []
    if len(shown) != 1:
        title = f"{target.object_id}: {len(shown)} grasps"
        panels.append(draw_panel(title, target, hand, shown, colors, view_direction(hand, shown[0])))
    for number, (grasp, color) in enumerate(zip(shown, colors, strict=True), start=1):
        title = caption(number, grasp)
        panels.append(draw_panel(title, target, hand, [grasp], [color], view_direction(hand, grasp)))
    compose_panels(panels, path)


def render_trial(target: TargetObject, hand: HandModel, grasp: Grasp, path: str | Path) -> None:
    """Write a picture of one trial, whatever its outcome, seen from three sides.

    Args:
        target: the object.
        hand: the hand.
        grasp: the trial with its final posture.
        path: file to write; its suffix says the format (png). Folders that do not exist are made.
    """
    first = view_direction(hand, grasp)
    R = grasp.T_object_tcp.rotation.as_matrix()
    views = {
        caption(1, grasp).removeprefix("1: "): first,
        "from behind the hand": -R @ hand.palm_normal + 0.3 * R[:, 0],
        "from the side": np.cross(R @ hand.palm_normal, R[:, 0]) + 0.4 * R[:, 0],
    }
    panels = [
        draw_panel(title, target, hand, [grasp], [HAND_COLORS[0]], direction) for title, direction in views.items()
    ]
    compose_panels(panels, path)


def compose_panels(panels: Sequence[Panel], path: str | Path) -> None:
    """Write panels side by side, in two rows if there are many, into a picture; its suffix says the format."""
    columns = len(panels) if len(panels) <= 5 else (len(panels) + 1) // 2
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(PANEL_INCHES * columns, (PANEL_INCHES + 0.25) * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, panel in zip(axes.flat, panels, strict=False):
        axis.imshow(panel.image, interpolation="lanczos")
        # Contacts lie between finger and object, so they are marked on top of both.
        axis.scatter(*panel.contacts.T, s=14, c=[CONTACT_COLOR], edgecolors="white", linewidths=0.6, alpha=0.9)
        axis.set_title(panel.title, fontsize=11)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(str(path), dpi=140)
