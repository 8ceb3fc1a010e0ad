"""A hand as data: URDF and a short YAML (TCP, palm, finger chains, preshape, couplings)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import Grasp, HandPosture, Pose
from mebo_grasp.grasping.hand_description import FingerDescription, HandDescription, read_description
from mebo_grasp.grasping.icub_meshes import mesh_hand_file
from mebo_grasp.grasping.urdf import LinkShape, Urdf, read_urdf

FloatArray = npt.NDArray[np.float64]

HANDS_FOLDER = Path(__file__).parent / "hands"
HAND_NAMES: tuple[str, ...] = ("icub_left", "icub_right")
"""Hands that need no download."""
MESH_HANDS = {"icub_left_mesh": "left", "icub_right_mesh": "right"}
"""The iCub's hands with its meshes, and their sides; see ``icub_meshes``."""
PACKAGED_HANDS = {"icub_mk3_left": "icub-models"}
"""Hands whose URDF comes from a package of the Python package index, and which."""
ALL_HAND_NAMES: tuple[str, ...] = (*HAND_NAMES, *MESH_HANDS, *PACKAGED_HANDS)


def description_file(name: str) -> Path:
    """Return the YAML file of a hand given by name or path; that of a mesh hand is written first.

    Raises:
        InvalidHandError: no such hand, or the meshes are not installed.
    """
    if name in MESH_HANDS:
        return mesh_hand_file(HANDS_FOLDER / f"icub_{MESH_HANDS[name]}.yaml", MESH_HANDS[name])
    path = HANDS_FOLDER / f"{name}.yaml" if name in ALL_HAND_NAMES else Path(name)
    if path.is_file():
        return path
    raise InvalidHandError(
        f"no hand '{name}'; use one of {', '.join(ALL_HAND_NAMES)} or the path of a hand's YAML file"
    )


@dataclass(frozen=True)
class PlacedShape:
    """A collision or display primitive of a link at a given posture.

    Args:
        link: name of the link.
        kind: box, sphere, cylinder, capsule or mesh.
        dims: box: three sides; sphere: radius; cylinder and capsule: radius, length (of a capsule between the
            centres of its caps) along z; mesh: empty. Metres.
        T_tcp_shape: pose of the shape's own frame in the TCP frame.
        vertices: vertices of a mesh in its own frame, (n, 3), metres; None for the others.
    """

    link: str
    kind: str
    dims: tuple[float, ...]
    T_tcp_shape: Pose
    vertices: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class HandModel:
    """A hand: kinematics, collision shapes, closing chains and couplings.

    Use ``load``; the constructor checks that description and URDF fit together.

    Raises:
        InvalidHandError: description and URDF contradict each other.
    """

    description: HandDescription
    urdf: Urdf
    preshape: HandPosture = field(init=False)

    def __post_init__(self) -> None:
        check_description(self.description, self.urdf)
        values = [float(self.description.preshape.get(name, 0.0)) for name in self.urdf.joint_names]
        object.__setattr__(self, "preshape", HandPosture(self.urdf.joint_names, tuple(values)))

    @classmethod
    def load(cls, name_or_path: str | Path) -> HandModel:
        """Load one of ``ALL_HAND_NAMES``, or the YAML file of that path.

        Raises:
            InvalidHandError: unknown name, package that is not installed, unreadable file or inconsistent description.
        """
        path = description_file(str(name_or_path))
        description = read_description(path)
        return cls(description, read_urdf(description.urdf_path))

    @property
    def name(self) -> str:
        """Name of the hand."""
        return self.description.name

    @property
    def urdf_path(self) -> Path:
        """File with the hand's URDF, for ``robot_description``."""
        return self.description.urdf_path

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the movable joints, in the order of every posture."""
        return self.urdf.joint_names

    @property
    def lower(self) -> FloatArray:
        """Lower joint limits, radians, in the order of ``joint_names``."""
        return np.array([self.urdf.joint(name).lower for name in self.joint_names])

    @property
    def upper(self) -> FloatArray:
        """Upper joint limits, radians, in the order of ``joint_names``."""
        return np.array([self.urdf.joint(name).upper for name in self.joint_names])

    @property
    def fingers(self) -> tuple[FingerDescription, ...]:
        """Finger chains in closing order."""
        return self.description.fingers

    @property
    def approach_axis(self) -> FloatArray:
        """Unit direction from the grasp centre away from the hand, TCP frame, shape (3,)."""
        return np.array(self.description.approach_axis)

    @property
    def palm_normal(self) -> FloatArray:
        """Unit normal out of the palm, TCP frame, shape (3,)."""
        return np.array(self.description.palm_normal)

    @property
    def grasp_center(self) -> FloatArray:
        """Where a grasped thing sits, TCP frame, shape (3,), metres."""
        return np.array(self.description.grasp_center)

    @property
    def couplings(self) -> Mapping[str, Mapping[str, float]]:
        """Joint name to {motor: coefficient}: joint = sum of coefficient times motor."""
        return self.description.couplings

    def posture(self, joints: Mapping[str, float] | Sequence[float] | HandPosture | None = None) -> HandPosture:
        """Return a full posture: the preshape, changed by the joints given.

        Raises:
            InvalidHandError: an unknown joint, or a sequence of the wrong length.
        """
        if joints is None:
            return self.preshape
        if isinstance(joints, HandPosture):
            joints = dict(zip(joints.names, joints.positions, strict=True))
        if not isinstance(joints, Mapping):
            if len(joints) != len(self.joint_names):
                raise InvalidHandError(f"hand '{self.name}' has {len(self.joint_names)} joints, got {len(joints)}")
            return HandPosture(self.joint_names, tuple(float(value) for value in joints))
        unknown = sorted(set(joints) - set(self.joint_names))
        if unknown:
            raise InvalidHandError(
                f"hand '{self.name}' has no joint {', '.join(unknown)}; it has {', '.join(self.joint_names)}"
            )
        values = dict(zip(self.preshape.names, self.preshape.positions, strict=True)) | dict(joints)
        return HandPosture(self.joint_names, tuple(float(values[name]) for name in self.joint_names))

    def link_transforms(self, posture: HandPosture | None = None) -> dict[str, FloatArray]:
        """Return the pose of every link in the TCP frame as (4, 4) matrices."""
        full = self.posture(posture)
        T_root = self.urdf.link_transforms(dict(zip(full.names, full.positions, strict=True)))
        T_tcp_root = np.linalg.inv(T_root[self.description.tcp_link] @ self.description.T_link_tcp.matrix)
        return {link: T_tcp_root @ T for link, T in T_root.items()}

    def link_geometry(self, posture: HandPosture | None = None, collision: bool = False) -> list[PlacedShape]:
        """Return the shapes of all links in the TCP frame: those for display, or those that may collide."""
        transforms = self.link_transforms(posture)
        shapes = self.urdf.collisions if collision else self.urdf.visuals
        return [place_shape(shape, transforms[shape.link]) for shape in shapes]

    def joints_from_motors(self, motors: Mapping[str, float]) -> HandPosture:
        """Return the posture that motor values give through the couplings; other joints keep the preshape.

        A motor that no joint is coupled to (abduction: the iCub models keep their fingers side by side) moves
        nothing.

        Args:
            motors: motor name to value, radians.

        Raises:
            InvalidHandError: an unknown motor, or a value out of its limits.
        """
        known = {motor for row in self.couplings.values() for motor in row} | set(self.description.motor_limits)
        unknown = sorted(set(motors) - known)
        if unknown:
            raise InvalidHandError(
                f"hand '{self.name}' has no motor {', '.join(unknown)}; it has {', '.join(sorted(known))}"
            )
        for motor, value in motors.items():
            lower, upper = self.description.motor_limits.get(motor, (-np.inf, np.inf))
            if not lower - 1e-9 <= value <= upper + 1e-9:
                raise InvalidHandError(
                    f"hand '{self.name}': motor '{motor}' is at {value:.4g} rad, its limits are "
                    f"{lower:.4g} to {upper:.4g}"
                )
        joints = {
            joint: sum(coefficient * motors[motor] for motor, coefficient in row.items())
            for joint, row in self.couplings.items()
            if all(motor in motors for motor in row)
        }
        return self.posture(joints)


def place_shape(shape: LinkShape, T_tcp_link: FloatArray) -> PlacedShape:
    """Return a link's shape in the TCP frame."""
    return PlacedShape(
        shape.link, shape.kind, shape.dims, Pose.from_matrix(T_tcp_link @ shape.T_link_shape), shape.vertices
    )


def shapes_in_grasp(hand: HandModel, grasp: Grasp) -> list[PlacedShape]:
    """Return the shapes for display, in the TCP frame, of the hand that made a grasp, in its final posture.

    Args:
        hand: the hand; for a grasp by another one of ``HAND_NAMES`` that one is taken.
        grasp: tells hand and posture; where its posture is of another hand, the preshape is taken.
    """
    if grasp.hand != hand.name and grasp.hand in HAND_NAMES:
        hand = HandModel.load(grasp.hand)
    try:
        return hand.link_geometry(grasp.hand_posture)
    except InvalidHandError:
        return hand.link_geometry()


def check_description(description: HandDescription, urdf: Urdf) -> None:
    """Check that every name of the description exists in the URDF and that chains make sense.

    Raises:
        InvalidHandError: naming what does not fit.
    """
    for link in (description.tcp_link, *description.palm_links):
        if link not in urdf.links:
            raise InvalidHandError(f"hand '{description.name}': no link '{link}' in {description.urdf_path.name}")
    named = [joint for finger in description.fingers for joint in finger.joints]
    for joint in (*named, *description.preshape, *description.couplings):
        if joint not in urdf.joint_names:
            raise InvalidHandError(
                f"hand '{description.name}': no movable joint '{joint}' in {description.urdf_path.name}; "
                f"it has {', '.join(urdf.joint_names)}"
            )
    if len(set(named)) != len(named):
        raise InvalidHandError(f"hand '{description.name}': a joint stands in two finger chains")
    if not urdf.collisions:
        raise InvalidHandError(
            f"hand '{description.name}' can touch nothing: no link in {description.urdf_path.name} has any to collide"
        )
    _check_chains(description, urdf)
    _check_preshape(description, urdf)


def _check_chains(description: HandDescription, urdf: Urdf) -> None:
    for finger in description.fingers:
        for parent, child in zip(finger.joints[:-1], finger.joints[1:], strict=True):
            if not urdf.is_ancestor(parent, child):
                raise InvalidHandError(
                    f"hand '{description.name}', finger '{finger.name}': joint '{child}' does not follow '{parent}'"
                )


def _check_preshape(description: HandDescription, urdf: Urdf) -> None:
    for joint, value in description.preshape.items():
        limits = urdf.joint(joint)
        if not limits.lower - 1e-9 <= value <= limits.upper + 1e-9:
            raise InvalidHandError(
                f"hand '{description.name}': preshape of '{joint}' is {value:.4g} rad, its limits are "
                f"{limits.lower:.4g} to {limits.upper:.4g}"
            )
    check_couplings(description, urdf)


def check_couplings(description: HandDescription, urdf: Urdf) -> None:
    """Check that every coupled joint stays within its limits while its motors stay within theirs.

    Joints with a motor that has no limits are left alone.

    Raises:
        InvalidHandError: a joint that its motors can drive beyond its own limits.
    """
    motors = description.motor_limits
    for joint, row in description.couplings.items():
        if not row or any(motor not in motors for motor in row):
            continue
        ends = np.array([np.multiply(coefficient, motors[motor]) for motor, coefficient in row.items()])
        lowest, highest = float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())
        limits = urdf.joint(joint)
        if lowest < limits.lower - 1e-6 or highest > limits.upper + 1e-6:
            raise InvalidHandError(
                f"hand '{description.name}': the motors of '{joint}' drive it from {lowest:.4g} to "
                f"{highest:.4g} rad, its limits are {limits.lower:.4g} to {limits.upper:.4g}"
            )
