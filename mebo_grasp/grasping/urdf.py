"""A small URDF reader: the tree of joints, and the collision and display shapes of the links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidHandError, InvalidObjectError
from mebo_grasp.grasping.package_files import resolve
from mebo_grasp.grasping.target_object import check_finite, load_mesh

FloatArray = npt.NDArray[np.float64]

MOVABLE = ("revolute", "continuous")
PRIMITIVES = ("box", "sphere", "cylinder", "capsule")
CONTINUOUS_LIMIT = float(np.pi)
SAME_POINT = 1e-5
"""Distance below which two shape origins of one link are taken for equal, metres."""


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A primitive fixed to a link; ``dims`` as in ``hand_model.PlacedShape``."""

    link: str
    kind: str
    dims: tuple[float, ...]
    T_link_shape: FloatArray
    vertices: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint: its frame in the parent link at zero, its axis in that frame and its limits in radians."""

    name: str
    movable: bool
    parent: str
    child: str
    T_parent_joint: FloatArray
    axis: FloatArray
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Urdf:
    """A tree of links; joints are ordered from the root outwards, as they stand in the file."""

    root: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    collisions: tuple[LinkShape, ...]
    visuals: tuple[LinkShape, ...]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the movable joints."""
        return tuple(joint.name for joint in self.joints if joint.movable)

    def joint(self, name: str) -> UrdfJoint:
        """Return the joint of that name.

        Raises:
            InvalidHandError: no such joint.
        """
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise InvalidHandError(f"no joint '{name}' in the URDF")

    def parent_joint(self, link: str) -> UrdfJoint | None:
        """Return the joint that carries a link, or None for the root."""
        return next((joint for joint in self.joints if joint.child == link), None)

    def is_ancestor(self, ancestor: str, descendant: str) -> bool:
        """Whether the joint ``descendant`` moves with the joint ``ancestor``."""
        joint: UrdfJoint | None = self.joint(descendant)
        while joint is not None:
            joint = self.parent_joint(joint.parent)
            if joint is not None and joint.name == ancestor:
                return True
        return False

    def link_transforms(self, positions: Mapping[str, float]) -> dict[str, FloatArray]:
        """Return every link's pose in the root frame, (4, 4); joints not named stand at 0."""
        transforms = {self.root: np.eye(4)}
        for joint in self.joints:
            T = transforms[joint.parent] @ joint.T_parent_joint
            if joint.movable:
                turn = np.eye(4)
                turn[:3, :3] = Rotation.from_rotvec(joint.axis * positions.get(joint.name, 0.0)).as_matrix()
                T = T @ turn
            transforms[joint.child] = T
        return transforms


def read_urdf(path: Path) -> Urdf:
    """Read a URDF file; meshes are loaded and replaced by their convex hulls.

    Raises:
        InvalidHandError: the file is unreadable, is no tree, or uses a joint or shape that a hand cannot have.
    """
    try:
        robot = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, LookupError, ValueError) as error:  # the last two of its encoding
        raise InvalidHandError(f"cannot read the URDF '{path}': {error}") from error
    try:
        links = tuple(_attribute(link, "name") for link in robot.findall("link"))
        joints = [_joint(element) for element in robot.findall("joint")]
        _check_distinct("link", links)
        _check_distinct("joint", [joint.name for joint in joints])
        root, ordered = _ordered(links, joints, path)
        collisions = _all_shapes(robot, "collision", path.parent)
        visuals = _all_shapes(robot, "visual", path.parent) or collisions
    except (TypeError, ValueError, InvalidObjectError) as error:
        raise InvalidHandError(f"URDF '{path}': {error}") from error
    return Urdf(root, links, ordered, collisions, visuals)


def _attribute(element: ElementTree.Element, name: str) -> str:
    value = element.get(name)
    if value is None:
        raise ValueError(f"<{element.tag}> lacks the attribute '{name}'")
    return value


def _check_distinct(what: str, names: Sequence[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{what} {', '.join(twice)} stands in the file more than once")


def _sizes(shape: ElementTree.Element, link: str) -> tuple[float, ...]:
    """Return the positive finite sizes of a primitive, metres."""
    if shape.tag == "box":
        sizes = tuple(_numbers(_attribute(shape, "size"), 3).tolist())
    elif shape.tag == "sphere":
        sizes = (float(_attribute(shape, "radius")),)
    else:
        sizes = (float(_attribute(shape, "radius")), float(_attribute(shape, "length")))
    if not all(np.isfinite(size) and size > 0.0 for size in sizes):
        raise ValueError(f"a {shape.tag} of link '{link}' has sizes {sizes}; they must be finite and above 0")
    return sizes


def _hull(path: Path, scale: FloatArray, link: str) -> FloatArray:
    """Return the vertices of a mesh file's convex hull, (n, 3), metres."""
    mesh = load_mesh(path)
    check_finite(mesh, path.name)
    vertices = np.array(mesh.vertices) * scale
    try:
        return np.array(trimesh.PointCloud(vertices).convex_hull.vertices)
    except QhullError as error:
        raise ValueError(f"the mesh '{path.name}' of link '{link}' is flat; give it a volume") from error


def _numbers(text: str, count: int) -> FloatArray:
    values = np.array([float(word) for word in text.split()])
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ValueError(f"expected {count} finite numbers, got '{text}'")
    return values


def _origin(element: ElementTree.Element) -> FloatArray:
    T = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        T[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3)
        T[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"), 3)).as_matrix()
    return T


def _joint(element: ElementTree.Element) -> UrdfJoint:
    name, kind = _attribute(element, "name"), _attribute(element, "type")
    if kind not in (*MOVABLE, "fixed"):
        raise ValueError(f"joint '{name}' is of type '{kind}'; only revolute, continuous and fixed ones are known")
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError(f"joint '{name}' lacks its parent or child")
    axis_element, limit = element.find("axis"), element.find("limit")
    axis = _numbers("1 0 0" if axis_element is None else _attribute(axis_element, "xyz"), 3)
    norm = float(np.linalg.norm(axis))
    if norm < 1e-9:
        raise ValueError(f"joint '{name}' has a zero axis")
    lower, upper = -CONTINUOUS_LIMIT, CONTINUOUS_LIMIT
    if kind == "revolute":
        if limit is None:
            raise ValueError(f"revolute joint '{name}' lacks its limits")
        lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    if not (np.isfinite(lower) and np.isfinite(upper)):
        raise ValueError(f"joint '{name}' has limits {lower} to {upper}; they must be finite")
    if not lower <= upper:
        raise ValueError(f"joint '{name}' has lower limit {lower} above upper limit {upper}")
    return UrdfJoint(
        name,
        kind in MOVABLE,
        _attribute(parent, "link"),
        _attribute(child, "link"),
        _origin(element),
        axis / norm,
        lower,
        upper,
    )


def _ordered(links: tuple[str, ...], joints: list[UrdfJoint], path: Path) -> tuple[str, tuple[UrdfJoint, ...]]:
    children = {joint.child for joint in joints}
    roots = [link for link in links if link not in children]
    if len(roots) != 1 or len(children) != len(joints):
        raise ValueError(f"'{path.name}' is no tree with one root: roots {roots}")
    placed, ordered, left = {roots[0]}, [], list(joints)
    while left:
        ready = [joint for joint in left if joint.parent in placed]
        if not ready:
            raise ValueError(f"joints {[joint.name for joint in left]} hang from no known link")
        ordered.extend(ready)
        placed.update(joint.child for joint in ready)
        left = [joint for joint in left if joint not in ready]
    by_file = {joint.name: index for index, joint in enumerate(joints)}
    depth_first: list[UrdfJoint] = []

    def descend(link: str) -> None:
        for joint in sorted((j for j in ordered if j.parent == link), key=lambda j: by_file[j.name]):
            depth_first.append(joint)
            descend(joint.child)

    descend(roots[0])
    return roots[0], tuple(depth_first)


def _all_shapes(robot: ElementTree.Element, tag: str, folder: Path) -> tuple[LinkShape, ...]:
    shapes: list[LinkShape] = []
    for link in robot.findall("link"):
        name = _attribute(link, "name")
        shapes.extend(merge_capsules([_shape(element, name, folder) for element in link.findall(tag)]))
    return tuple(shapes)


def _shape(element: ElementTree.Element, link: str, folder: Path) -> LinkShape:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise ValueError(f"a <{element.tag}> of link '{link}' needs exactly one geometry")
    shape, T = geometry[0], _origin(element)
    if shape.tag in PRIMITIVES:
        return LinkShape(link, shape.tag, _sizes(shape, link), T)
    if shape.tag == "mesh":
        file = resolve(_attribute(shape, "filename"), folder, folder / "urdf")
        scale = _numbers(shape.get("scale", "1 1 1"), 3)
        return LinkShape(link, "mesh", (), T, _hull(file, scale, link))
    raise ValueError(f"link '{link}' has an unknown shape '{shape.tag}'")


def merge_capsules(shapes: list[LinkShape]) -> list[LinkShape]:
    """Replace each cylinder that has a sphere of its radius at both ends by a capsule.

    URDF has no capsule of its own; this is how one is written with standard shapes.
    """
    spheres = [shape for shape in shapes if shape.kind == "sphere"]
    merged: list[LinkShape] = []
    used: set[int] = set()
    for shape in shapes:
        caps = _caps(shape, spheres) if shape.kind == "cylinder" else []
        if len(caps) == 2:
            used.update(id(cap) for cap in caps)
            merged.append(LinkShape(shape.link, "capsule", shape.dims, shape.T_link_shape))
        else:
            merged.append(shape)
    return [shape for shape in merged if id(shape) not in used]


def _caps(cylinder: LinkShape, spheres: list[LinkShape]) -> list[LinkShape]:
    radius, length = cylinder.dims
    found = []
    for sign in (-0.5, 0.5):
        end = cylinder.T_link_shape[:3, 3] + cylinder.T_link_shape[:3, 2] * sign * length
        for sphere in spheres:
            near = np.linalg.norm(sphere.T_link_shape[:3, 3] - end) < SAME_POINT
            if near and abs(sphere.dims[0] - radius) < SAME_POINT and sphere not in found:
                found.append(sphere)
                break
    return found
