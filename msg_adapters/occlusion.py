"""Occluding shapes: ``Occlusion`` and ``OcclusionArray``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from mebo_grasp_interfaces.msg import OcclusionArray
from shape_msgs.msg import Mesh as MeshMsg
from shape_msgs.msg import MeshTriangle, SolidPrimitive

from mebo_grasp.errors import (
    InvalidMessageError,
    InvalidOcclusionError,
    InvalidPoseError,
    WrongFrameError,
)
from mebo_grasp.grasp import Pose
from mebo_grasp.solutions.frames import FrameTree
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Shape,
    Sphere,
    TriangleMesh,
)
from msg_adapters.pose import from_point_msg, from_pose_msg, to_point_msg, to_pose_msg
from msg_adapters.time import to_time_msg
from msg_adapters.transform import from_transform_stamped_msg

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
    message = OcclusionMsg(id=occlusion.id, pose=to_pose_msg(occlusion.T_object_shape), margin=float(occlusion.margin))
    if isinstance(occlusion.shape, TriangleMesh):
        message.mesh = to_mesh_msg(occlusion.shape)
    else:
        message.shape = to_solid_primitive_msg(occlusion.shape)
    message.header.frame_id = frame_id
    message.header.stamp = to_time_msg(stamp_ns)
    return message


def from_occlusion_msg(message: OcclusionMsg, expected_frame: str, frames: FrameTree | None = None) -> Occlusion:
    """Return the occlusion of a message.

    Args:
        message: with a shape or a mesh.
        expected_frame: the object's frame.
        frames: static transforms that are known beside those in the message.

    Raises:
        WrongFrameError: it is given in another frame than the object's, and no transform leads there.
        InvalidMessageError: the shape is unknown, there are both a shape and a mesh, or a transform or
            the pose is not usable.
        InvalidOcclusionError: it has no name, or a length is not usable.
    """
    name = f"occlusion '{message.id}'"
    try:
        shape, pose = _shape_of(message), from_pose_msg(message.pose)
        T_object_frame = _place_of_frame(message, expected_frame, frames or FrameTree())
        if T_object_frame is not None:
            pose = T_object_frame @ pose
    except WrongFrameError:
        raise
    except InvalidOcclusionError as error:
        raise InvalidOcclusionError(f"{name}: {error}") from error
    except (InvalidMessageError, InvalidPoseError) as error:
        raise InvalidMessageError(f"{name}: {error}") from error
    return Occlusion(message.id, shape, pose, float(message.margin))


def _shape_of(message: OcclusionMsg) -> Shape:
    if not message.mesh.triangles:
        return from_solid_primitive_msg(message.shape)
    if message.shape.dimensions:
        raise InvalidMessageError("both a mesh and the dimensions of a shape are given; leave one empty")
    return from_mesh_msg(message.mesh)


def _place_of_frame(message: OcclusionMsg, expected_frame: str, frames: FrameTree) -> Pose | None:
    """Return the pose of the message's frame in the object's; None when they are the same."""
    frame = message.header.frame_id.lstrip("/")
    if frame == expected_frame:
        return None
    own = [from_transform_stamped_msg(transform) for transform in message.transforms]
    pose = frames.with_links(own).lookup(expected_frame, frame)
    if pose is None:
        raise WrongFrameError(
            f"occlusion '{message.id}' is given in frame '{frame}', and no static transform that is known "
            f"leads from there to the object's frame '{expected_frame}'; give it in '{expected_frame}', or "
            "make the transform known: in its field transforms, by the node's parameter static_transforms "
            "or on /tf_static"
        )
    return pose


def from_occlusion_msgs(
    messages: Iterable[OcclusionMsg], expected_frame: str, frames: FrameTree | None = None
) -> tuple[Occlusion, ...]:
    """Return the occlusions of several messages.

    Args:
        messages: each with its frame in its own header.
        expected_frame: the object's frame.
        frames: static transforms that are known beside those in the messages.

    Raises:
        WrongFrameError: no transform leads from the frame of one to the object's.
        InvalidMessageError: a shape, a transform or a pose is not usable.
        InvalidOcclusionError: a name is empty or occurs twice, or a length is not usable.
    """
    occlusions = tuple(from_occlusion_msg(message, expected_frame, frames) for message in messages)
    ids = [occlusion.id for occlusion in occlusions]
    if len(set(ids)) < len(ids):
        repeated = ", ".join(sorted({name for name in ids if ids.count(name) > 1}))
        raise InvalidOcclusionError(f"names of occlusions must be unique, these are not: {repeated}")
    return occlusions


def to_occlusion_array_msg(occlusions: Iterable[Occlusion], frame_id: str, stamp_ns: int = 0) -> OcclusionArray:
    """Return all occlusions known now as one message.

    Raises:
        InvalidMessageError: the stamp or a shape cannot be sent.
    """
    message = OcclusionArray(occlusions=[to_occlusion_msg(occlusion, frame_id, stamp_ns) for occlusion in occlusions])
    message.header.frame_id = frame_id
    message.header.stamp = to_time_msg(stamp_ns)
    return message


def from_occlusion_array_msg(
    message: OcclusionArray, expected_frame: str, frames: FrameTree | None = None
) -> tuple[Occlusion, ...]:
    """Return the occlusions of a message; each carries its frame in its own header.

    Raises:
        MeboGraspError: as ``from_occlusion_msgs`` says.
    """
    return from_occlusion_msgs(message.occlusions, expected_frame, frames)
