"""What RViz is shown: the object, hands in their final posture, contacts and occlusions."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
import trimesh
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import FloatArray, Grasp, GraspContact, Pose
from mebo_grasp.grasping.hand_model import ALL_HAND_NAMES, HandModel, PlacedShape, shapes_in_grasp
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.solutions.occlusion import Box, Cone, Occlusion, Sphere, TriangleMesh
from msg_adapters.pose import to_point_msg, to_pose_msg

CONTACT_ARROW_LENGTH = 0.02
OBJECT_COLOR = ColorRGBA(r=0.75, g=0.75, b=0.78, a=0.6)
CONTACT_COLOR = ColorRGBA(r=0.9, g=0.1, b=0.1, a=1.0)
OCCLUSION_COLOR = ColorRGBA(r=0.9, g=0.1, b=0.1, a=0.25)
ROUND_SECTIONS = 24
"""Corners of the circle of which a cone is drawn."""


def object_markers(target: TargetObject) -> MarkerArray:
    """Return the object's mesh as a marker in its own frame."""
    return MarkerArray(
        markers=[
            _clear(target.object_id),
            _mesh_marker(target.object_id, "object", 0, target.mesh, Pose.identity(), OBJECT_COLOR),
        ]
    )


def grasp_markers(grasps: Sequence[Grasp], frame_id: str, hand: HandModel | None = None) -> MarkerArray:
    """Return hands in their final posture with their contacts, one colour a grasp, old ones deleted.

    Args:
        grasps: best first.
        frame_id: the object's frame.
        hand: the hand of grasps that carry its name, beside the built-in ones; that of any other is an arrow.
    """
    markers = [_clear(frame_id)]
    for rank, grasp in enumerate(grasps):
        markers += _parts_of(grasp, rank, len(grasps), frame_id, hand)
    return MarkerArray(markers=markers)


@lru_cache(maxsize=64)
def _parts_of(grasp: Grasp, rank: int, count: int, frame_id: str, hand: HandModel | None) -> tuple[Marker, ...]:
    """The markers of one grasp: kept, since they take 7 ms and a new occlusion leaves most grasps of a set."""
    contacts = [_contact_marker(rank, number, contact, frame_id) for number, contact in enumerate(grasp.contacts)]
    return (*_hand_markers(rank, grasp, _rank_color(rank, count), frame_id, hand), *contacts)


def solution_markers(
    grasps: Sequence[Grasp], occlusions: Iterable[Occlusion], frame_id: str, hand: HandModel | None = None
) -> MarkerArray:
    """Return the hands of the solution set, as ``grasp_markers`` does, and the regions that are occluded."""
    array = grasp_markers(grasps, frame_id, hand)
    array.markers += [_occlusion_marker(number, occlusion, frame_id) for number, occlusion in enumerate(occlusions)]
    return array


@lru_cache(maxsize=8)
def _built_in(name: str) -> HandModel | None:
    """The model of a built-in hand, or None for any other and for one whose package is not installed."""
    try:
        return HandModel.load(name) if name in ALL_HAND_NAMES else None
    except InvalidHandError:
        return None


@lru_cache(maxsize=256)
def _hull_of(vertices: bytes) -> trimesh.Trimesh:
    """The convex hull of points, shape (n, 3), given as bytes: a hand has the same links in every grasp."""
    return trimesh.convex.convex_hull(np.frombuffer(vertices).reshape(-1, 3))


def _hand_markers(rank: int, grasp: Grasp, color: ColorRGBA, frame_id: str, hand: HandModel | None) -> list[Marker]:
    if hand is None or hand.name != grasp.hand:
        hand = _built_in(grasp.hand)
    if hand is None:
        return [_tcp_marker(rank, grasp, color, frame_id)]
    namespace = f"hand {rank + 1}"
    markers: list[Marker] = []
    caps: dict[float, list[Point]] = {}
    for shape in shapes_in_grasp(hand, grasp):
        pose = grasp.T_object_tcp @ shape.T_tcp_shape
        markers.append(_shape_marker(frame_id, namespace, len(markers), shape, pose, color))
        if shape.kind == "capsule":
            radius, length = shape.dims
            ends = pose.transform_points(np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]]))
            caps.setdefault(radius, []).extend(_points(ends))
    for radius, points in caps.items():
        markers.append(_cap_marker(frame_id, namespace, len(markers), radius, points, color))
    return markers


def _shape_marker(
    frame_id: str, namespace: str, number: int, shape: PlacedShape, pose: Pose, color: ColorRGBA
) -> Marker:
    """Return a primitive: RViz draws those itself, where a mesh of them would be sent corner by corner."""
    if shape.vertices is not None:
        hull = _hull_of(np.asarray(shape.vertices, dtype=np.float64).tobytes())
        return _mesh_marker(frame_id, namespace, number, hull, pose, color)
    if shape.kind == "box":
        kind, (x, y, z) = Marker.CUBE, shape.dims
    elif shape.kind == "sphere":
        kind, x = Marker.SPHERE, 2.0 * shape.dims[0]
        y = z = x
    else:
        kind, x, z = Marker.CYLINDER, 2.0 * shape.dims[0], shape.dims[1]
        y = x
    marker = _marker(frame_id, namespace, number, kind, pose, color)
    marker.scale = Vector3(x=x, y=y, z=z)
    return marker


def _cap_marker(
    frame_id: str, namespace: str, number: int, radius: float, points: list[Point], color: ColorRGBA
) -> Marker:
    marker = _marker(frame_id, namespace, number, Marker.SPHERE_LIST, Pose.identity(), color)
    marker.scale = Vector3(x=2.0 * radius, y=2.0 * radius, z=2.0 * radius)
    marker.points = points
    return marker


def _mesh_marker(
    frame_id: str, namespace: str, number: int, mesh: trimesh.Trimesh, pose: Pose, color: ColorRGBA
) -> Marker:
    marker = _marker(frame_id, namespace, number, Marker.TRIANGLE_LIST, pose, color)
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    marker.points = _points(mesh.triangles.reshape(-1, 3))
    return marker


def _contact_marker(rank: int, number: int, contact: GraspContact, frame_id: str) -> Marker:
    marker = _marker(frame_id, f"contacts {rank + 1}", number, Marker.ARROW, Pose.identity(), CONTACT_COLOR)
    marker.scale = Vector3(x=0.002, y=0.005, z=0.0)
    start = contact.position - CONTACT_ARROW_LENGTH * contact.normal
    marker.points = [to_point_msg(start), to_point_msg(contact.position)]
    return marker


def _tcp_marker(rank: int, grasp: Grasp, color: ColorRGBA, frame_id: str) -> Marker:
    marker = _marker(frame_id, f"hand {rank + 1}", 0, Marker.ARROW, grasp.T_object_tcp, color)
    marker.scale = Vector3(x=0.06, y=0.006, z=0.006)
    return marker


def _occlusion_marker(number: int, occlusion: Occlusion, frame_id: str) -> Marker:
    shape, pose = occlusion.shape, occlusion.T_object_shape
    if isinstance(shape, Cone):
        cone = trimesh.creation.cone(radius=shape.radius, height=shape.height, sections=ROUND_SECTIONS)
        # The cone's frame lies at mid-height, trimesh's at the base.
        cone.apply_translation([0.0, 0.0, -shape.height / 2.0])
        return _mesh_marker(frame_id, "occlusions", number, cone, pose, OCCLUSION_COLOR)
    if isinstance(shape, TriangleMesh):
        mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        return _mesh_marker(frame_id, "occlusions", number, mesh, pose, OCCLUSION_COLOR)
    if isinstance(shape, Box):
        kind, (x, y, z) = Marker.CUBE, shape.size
    elif isinstance(shape, Sphere):
        kind, x = Marker.SPHERE, 2.0 * shape.radius
        y = z = x
    else:
        kind, x, z = Marker.CYLINDER, 2.0 * shape.radius, shape.height
        y = x
    marker = _marker(frame_id, "occlusions", number, kind, pose, OCCLUSION_COLOR)
    marker.scale = Vector3(x=float(x), y=float(y), z=float(z))
    return marker


def _clear(frame_id: str) -> Marker:
    marker = Marker(action=Marker.DELETEALL)
    marker.header.frame_id = frame_id
    marker.pose.orientation.w = 1.0
    return marker


def _marker(frame_id: str, namespace: str, number: int, kind: int, pose: Pose, color: ColorRGBA) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, color=color, pose=to_pose_msg(pose))
    marker.header.frame_id = frame_id
    return marker


def _points(corners: FloatArray) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in np.asarray(corners, dtype=float).tolist()]


def _rank_color(rank: int, count: int) -> ColorRGBA:
    r, g, b = colorsys.hsv_to_rgb(rank / max(count, 1), 0.75, 0.95)
    return ColorRGBA(r=r, g=g, b=b, a=0.9)
