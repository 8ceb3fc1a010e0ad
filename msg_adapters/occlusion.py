"""Occluding shapes: ``Occlusion`` and ``OcclusionArray``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from mebo_grasp_interfaces.msg import OcclusionArray
from shape_msgs.msg import Mesh as MeshMsg
from shape_msgs.msg import MeshTriangle, SolidPrimitive

from mebo_grasp.errors import InvalidMessageError, InvalidOcclusionError
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Shape,
    Sphere,
    TriangleMesh,
)
from msg_adapters.checks import require_frame
from msg_adapters.pose import from_point_msg, from_pose_msg, to_point_msg, to_pose_msg
from msg_adapters.time import to_time_msg

# SolidPrimitive names the order of the dimensions: heights stand before radii.
_SHAPES: dict[int, tuple[str, int, Callable[[Sequence[float]], Shape]]] = {
    SolidPrimitive.BOX: ("BOX", 3, lambda d: Box((d[0], d[1], d[2]))),
    SolidPrimitive.SPHERE: ("SPHERE", 1, lambda d: Sphere(d[0])),
    SolidPrimitive.CYLINDER: ("CYLINDER", 2, lambda d: Cylinder(height=d[0], radius=d[1])),
    SolidPrimitive.CONE: ("CONE", 2, lambda d: Cone(height=d[0], radius=d[1])),
}


def to_solid_primitive_msg(shape: Shape) -> SolidPrimitive:
    """Return the message of a shape.

    Raises:
        InvalidMessageError: a shape of this kind has no message.
    """
    if isinstance(shape, Box):
        return SolidPrimitive(type=SolidPrimitive.BOX, dimensions=list(shape.size))
    if isinstance(shape, Sphere):
        return SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[float(shape.radius)])
    if isinstance(shape, Cylinder | Cone):
        kind = SolidPrimitive.CYLINDER if isinstance(shape, Cylinder) else SolidPrimitive.CONE
        return SolidPrimitive(type=kind, dimensions=[float(shape.height), float(shape.radius)])
    raise InvalidMessageError(f"a {type(shape).__name__} cannot be sent as a SolidPrimitive")


def from_solid_primitive_msg(message: SolidPrimitive) -> Shape:
    """Return the shape of a message.

    Raises:
        InvalidMessageError: the type is unknown or has another number of dimensions.
        InvalidOcclusionError: a dimension is not finite and positive.
    """
    if message.type not in _SHAPES:
        known = ", ".join(f"{name}={kind}" for kind, (name, _, _) in _SHAPES.items())
        raise InvalidMessageError(f"primitive type {message.type} is not usable; use {known}")
    name, count, make = _SHAPES[message.type]
    dimensions = [float(length) for length in message.dimensions]
    if len(dimensions) != count:
        raise InvalidMessageError(f"a {name} has {count} dimensions, got {len(dimensions)}")
    return make(dimensions)


def to_mesh_msg(mesh: TriangleMesh) -> MeshMsg:
    """Return the message of a triangle mesh."""
    return MeshMsg(
        triangles=[MeshTriangle(vertex_indices=face.tolist()) for face in mesh.faces],
        vertices=[to_point_msg(vertex) for vertex in mesh.vertices],
    )


def from_mesh_msg(message: MeshMsg) -> TriangleMesh:
    """Return the triangle mesh of a message.

    Raises:
        InvalidOcclusionError: it has no triangle, a number is not finite, or a triangle names a vertex that
            is not there.
    """
    vertices = np.array([from_point_msg(vertex) for vertex in message.vertices]).reshape(-1, 3)
    faces = np.array([triangle.vertex_indices for triangle in message.triangles], dtype=np.int64)
    return TriangleMesh(vertices, faces.reshape(-1, 3))


def to_occlusion_msg(occlusion: Occlusion, frame_id: str, stamp_ns: int = 0) -> OcclusionMsg:
    """Return the message of an occlusion.

    Args:
        occlusion: in the object's frame.
        frame_id: the object's frame.
        stamp_ns: nanoseconds since the epoch.

    Raises:
        InvalidMessageError: the stamp or the shape cannot be sent.
    """
    message = OcclusionMsg(
        id=occlusion.id,
        shape=to_solid_primitive_msg(occlusion.shape),
        pose=to_pose_msg(occlusion.T_object_shape),
    )
    message.header.frame_id = frame_id
    message.header.stamp = to_time_msg(stamp_ns)
    return message


def from_occlusion_msg(message: OcclusionMsg, expected_frame: str) -> Occlusion:
    """Return the occlusion of a message.

    Raises:
        WrongFrameError: it is given in another frame than the object's.
        InvalidMessageError: the shape is unknown.
        InvalidOcclusionError: it has no name, or a dimension is not finite and positive.
        InvalidPoseError: its pose is not usable.
    """
    name = f"occlusion '{message.id}'"
    require_frame(message.header.frame_id, expected_frame, name)
    try:
        shape = from_solid_primitive_msg(message.shape)
    except (InvalidMessageError, InvalidOcclusionError) as error:
        raise type(error)(f"{name}: {error}") from error
    return Occlusion(message.id, shape, from_pose_msg(message.pose))


def from_occlusion_msgs(
    messages: Iterable[OcclusionMsg], expected_frame: str
) -> tuple[Occlusion, ...]:
    """Return the occlusions of several messages.

    Raises:
        WrongFrameError: one is given in another frame than the object's.
        InvalidMessageError: a shape is unknown.
        InvalidOcclusionError: a name is empty or occurs twice, or a dimension is not usable.
        InvalidPoseError: a pose is not usable.
    """
    occlusions = tuple(from_occlusion_msg(message, expected_frame) for message in messages)
    ids = [occlusion.id for occlusion in occlusions]
    if len(set(ids)) < len(ids):
        repeated = ", ".join(sorted({name for name in ids if ids.count(name) > 1}))
        raise InvalidOcclusionError(f"names of occlusions must be unique, these are not: {repeated}")
    return occlusions


def to_occlusion_array_msg(
    occlusions: Iterable[Occlusion], frame_id: str, stamp_ns: int = 0
) -> OcclusionArray:
    """Return all occlusions known now as one message.

    Raises:
        InvalidMessageError: the stamp or a shape cannot be sent.
    """
    message = OcclusionArray(
        occlusions=[to_occlusion_msg(occlusion, frame_id, stamp_ns) for occlusion in occlusions]
    )
    message.header.frame_id = frame_id
    message.header.stamp = to_time_msg(stamp_ns)
    return message


def from_occlusion_array_msg(message: OcclusionArray, expected_frame: str) -> tuple[Occlusion, ...]:
    """Return the occlusions of a message; each carries its frame in its own header.

    Raises:
        MeboGraspError: as ``from_occlusion_msgs`` says.
    """
    return from_occlusion_msgs(message.occlusions, expected_frame)
