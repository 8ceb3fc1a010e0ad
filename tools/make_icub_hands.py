"""Write the URDF and YAML of the two light iCub hands from a table of kinematics and link capsules.

Kinematics: the Simox/iKin iCub hand (left), the right hand is its mirror image in the plane z = 0 of the
hand frame. Capsules are fitted to the finger links, boxes to the palm. Lengths in millimetres here.

Run: python tools/make_icub_hands.py mebo_grasp/grasping/hands
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

HALF_PI = np.pi / 2.0
MIRROR = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Capsule:
    """Centre, unit axis, radius and length between the cap centres, millimetres, in the link frame."""

    centre: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius: float
    length: float


@dataclass(frozen=True)
class Finger:
    """Base pose in the palm frame, then the offsets from joint to joint, and a capsule a link."""

    name: str
    base_xyz: tuple[float, float, float]
    base_rpy: tuple[float, float, float]
    offsets: tuple[tuple[float, float, float], ...]
    turn: float
    limits: tuple[float, float]
    capsules: tuple[Capsule, ...]


TURN_THUMB = Rotation.from_euler("xyz", [HALF_PI, 0.0, HALF_PI])
PALM_TO_TCP = np.array([62.5, 0.0, 4.0])

FINGERS = (
    Finger(
        "thumb",
        (39.0, 12.0, 2.5),
        (0.0, 0.083141, -0.506844),
        ((21.1, 4.9, 0.0), (26.0, 0.0, 0.0), (22.0, 0.0, 0.0)),
        HALF_PI,
        (0.0, np.radians(120.0)),
        (
            Capsule((10.640, 2.562, -0.021), (0.958402, 0.283885, -0.029571), 6.312, 18.735),
            Capsule((13.075, 0.142, 0.175), (-0.998975, -0.014669, 0.042827), 6.210, 21.900),
            Capsule((11.471, -0.243, -0.067), (0.999244, -0.006152, 0.038397), 6.180, 18.101),
            Capsule((10.405, -0.541, -0.136), (-0.997810, 0.039409, -0.053119), 6.626, 14.590),
        ),
    ),
    Finger(
        "index",
        (64.25, 26.22, -6.7),
        (0.087266, 0.0, 0.071558),
        ((14.8, -1.75, 0.0), (25.9, 0.0, 0.0), (22.0, 0.0, 0.0)),
        HALF_PI,
        (-np.radians(25.0), np.radians(25.0)),
        (
            Capsule((7.236, -1.421, -0.384), (-0.994309, 0.099533, 0.037993), 5.952, 13.121),
            Capsule((13.327, -0.148, -0.090), (-0.999225, 0.015022, -0.036372), 6.194, 21.465),
            Capsule((11.454, -0.259, -0.064), (0.998704, -0.007573, 0.050329), 6.195, 18.174),
            Capsule((10.252, -0.577, -0.146), (0.998452, -0.034328, 0.043762), 6.642, 14.669),
        ),
    ),
    Finger(
        "middle",
        (65.0, 9.77, -7.6),
        (0.0, 0.0, 0.0),
        ((15.3, -2.2, 0.0), (25.8, 0.0, 0.0), (24.0, 0.0, 0.0)),
        HALF_PI,
        (-np.radians(25.0), np.radians(25.0)),
        (
            Capsule((6.700, -1.314, -0.225), (0.997368, -0.067432, -0.026638), 5.933, 15.108),
            Capsule((14.808, -0.153, -0.085), (0.999421, -0.017490, 0.029195), 6.173, 24.125),
            Capsule((12.457, -0.241, -0.068), (-0.999091, 0.008829, -0.041706), 6.186, 19.879),
            Capsule((10.313, -0.565, -0.159), (-0.998067, 0.042335, -0.045490), 6.640, 14.540),
        ),
    ),
    Finger(
        "ring",
        (64.13, -5.65, -7.0),
        (-0.087266, 0.0, -0.106465),
        ((14.8, -1.75, 0.0), (25.9, 0.0, 0.0), (22.0, 0.0, 0.0)),
        HALF_PI,
        (-np.radians(25.0), np.radians(25.0)),
        (
            Capsule((7.077, -1.494, -0.417), (0.989764, -0.135557, -0.044628), 5.900, 13.034),
            Capsule((13.389, -0.196, -0.050), (0.999330, -0.007863, 0.035741), 6.198, 21.386),
            Capsule((11.435, -0.216, -0.028), (0.998555, -0.008315, 0.053089), 6.153, 18.235),
            Capsule((10.316, -0.438, -0.173), (-0.998645, 0.029109, -0.043134), 6.682, 14.209),
        ),
    ),
    Finger(
        "little",
        (62.11, -24.54, -6.0),
        (-0.087266, 0.0, -0.106465),
        ((14.8, 1.75, 0.0), (21.9, 0.0, 0.0), (19.0, 0.0, 0.0)),
        HALF_PI,
        (-np.radians(25.0), np.radians(25.0)),
        (
            Capsule((7.152, 1.244, -0.330), (-0.996728, -0.058487, 0.055787), 5.899, 12.909),
            Capsule((11.401, -0.232, -0.051), (-0.999023, 0.016542, -0.040979), 6.203, 17.733),
            Capsule((9.969, -0.194, -0.115), (0.997499, -0.025845, 0.065788), 6.153, 15.209),
            Capsule((10.298, -0.543, -0.223), (0.998448, -0.035237, 0.043117), 6.625, 14.513),
        ),
    ),
)

# Boxes fitted to the palm's hull, left hand frame (x towards the fingers, palm facing -z): centre and size.
PALM_BOXES = (
    ((-16.0, 0.0, 11.0), (44.0, 60.0, 27.0)),
    ((-50.0, 0.0, 1.2), (45.0, 22.0, 7.0)),
)


def _matrix(xyz: np.ndarray, rotation: Rotation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    T[:3, 3] = xyz
    return T


def _finger_frames(finger: Finger) -> list[np.ndarray]:
    """Return each joint frame (z is the axis) in its parent's, the first one in the hand frame; left hand."""
    T_tcp_palm = _matrix(np.zeros(3), Rotation.from_euler("x", np.pi)) @ _matrix(-PALM_TO_TCP, Rotation.identity())
    base = _matrix(np.array(finger.base_xyz), Rotation.from_euler("xyz", finger.base_rpy))
    if finger.name == "thumb":
        base = base @ _matrix(np.zeros(3), TURN_THUMB)
    frames = [T_tcp_palm @ base]
    for index, offset in enumerate(finger.offsets):
        turn = Rotation.from_euler("x", finger.turn if index == 0 else 0.0)
        frames.append(_matrix(np.array(offset), turn))
    return frames


def _mirrored(T: np.ndarray) -> np.ndarray:
    """Reflect a frame in z = 0; its own z is reflected too, so a turn about z keeps its sign."""
    M4 = np.eye(4)
    M4[:3, :3] = MIRROR
    return M4 @ T @ M4


def _mirror_capsule(capsule: Capsule) -> Capsule:
    c, a = MIRROR @ np.array(capsule.centre), MIRROR @ np.array(capsule.axis)
    return Capsule(tuple(c), tuple(a), capsule.radius, capsule.length)


def _origin(parent: ElementTree.Element, xyz: np.ndarray, rpy: np.ndarray) -> None:
    clean = [" ".join(f"{round(float(v), 8) + 0.0:.8g}" for v in values) for values in (xyz, rpy)]
    ElementTree.SubElement(parent, "origin", xyz=clean[0], rpy=clean[1])


def _add_capsule(link: ElementTree.Element, tag: str, capsule: Capsule) -> None:
    """Add a capsule as standard URDF: a cylinder and a sphere at either end."""
    centre, axis = np.array(capsule.centre) / 1000.0, np.array(capsule.axis)
    axis = axis / np.linalg.norm(axis)
    rotation, _ = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])
    half = axis * capsule.length / 2000.0
    for xyz, shape in ((centre, "cylinder"), (centre + half, "sphere"), (centre - half, "sphere")):
        element = ElementTree.SubElement(link, tag)
        _origin(element, xyz, rotation.as_euler("xyz") if shape == "cylinder" else np.zeros(3))
        geometry = ElementTree.SubElement(element, "geometry")
        sizes = {"radius": f"{capsule.radius / 1000.0:.8g}"}
        if shape == "cylinder":
            sizes["length"] = f"{capsule.length / 1000.0:.8g}"
        ElementTree.SubElement(geometry, shape, sizes)


def _add_box(link: ElementTree.Element, tag: str, centre: np.ndarray, size: tuple[float, ...]) -> None:
    element = ElementTree.SubElement(link, tag)
    _origin(element, centre / 1000.0, np.zeros(3))
    geometry = ElementTree.SubElement(element, "geometry")
    ElementTree.SubElement(geometry, "box", size=" ".join(f"{side / 1000.0:.8g}" for side in size))


def _add_inertial(link: ElementTree.Element, mass: float) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    _origin(inertial, np.zeros(3), np.zeros(3))
    ElementTree.SubElement(inertial, "mass", value=f"{mass:g}")
    side = f"{mass * 1e-4:.3g}"
    ElementTree.SubElement(inertial, "inertia", ixx=side, iyy=side, izz=side, ixy="0", ixz="0", iyz="0")


def build_urdf(side: str) -> ElementTree.Element:
    """Return the URDF of the left or right hand; its root link is the hand frame (TCP)."""
    prefix, left = side[0], side == "left"
    robot = ElementTree.Element("robot", name=f"icub_{side}_hand")
    palm = ElementTree.SubElement(robot, "link", name=f"{prefix}_palm")
    _add_inertial(palm, 0.25)
    for centre, size in PALM_BOXES:
        mirrored = np.array(centre) if left else MIRROR @ np.array(centre)
        for tag in ("visual", "collision"):
            _add_box(palm, tag, mirrored, size)
    for finger in FINGERS:
        parent = f"{prefix}_palm"
        for index, (T, capsule) in enumerate(zip(_finger_frames(finger), finger.capsules, strict=True)):
            name = f"{prefix}_{finger.name}_{index}"
            link = ElementTree.SubElement(robot, "link", name=f"{name}_link")
            _add_inertial(link, 0.01)
            shape = capsule if left else _mirror_capsule(capsule)
            _add_capsule(link, "visual", shape)
            # The first links of the long fingers lie within the palm's outline and take no part in collisions.
            if index > 0 or finger.name == "thumb":
                _add_capsule(link, "collision", shape)
            joint = ElementTree.SubElement(robot, "joint", name=name, type="revolute")
            T = T if left else _mirrored(T)
            _origin(joint, T[:3, 3] / 1000.0, Rotation.from_matrix(T[:3, :3]).as_euler("xyz"))
            ElementTree.SubElement(joint, "parent", link=parent)
            ElementTree.SubElement(joint, "child", link=f"{name}_link")
            ElementTree.SubElement(joint, "axis", xyz="0 0 1")
            lower, upper = finger.limits if index == 0 else (0.0, HALF_PI)
            ElementTree.SubElement(joint, "limit", lower=f"{lower:.8g}", upper=f"{upper:.8g}", effort="1", velocity="1")
            parent = f"{name}_link"
    ElementTree.indent(robot)
    return robot


YAML_TEMPLATE = """\
# iCub {side} hand, light: capsules for the finger links, boxes for the palm. Written by tools/make_icub_hands.py.
# Lengths in metres, angles in radians; the TCP is the hand frame: mid-palm, x along the fingers.
name: icub_{side}
urdf: icub_{side}.urdf
synergies: icub_{side}_synergies.yaml   # written by tools/make_synergies.py
tcp: {{link: {p}_palm, xyz: [0, 0, 0], rpy: [0, 0, 0]}}
palm_links: [{p}_palm]
palm_normal: [0, 0, {out}]          # out of the palm, TCP frame
grasp_center: [-0.0025, -0.01, {gcp}]  # where a grasped thing sits, TCP frame
approach_axis: [0.70710678, 0, {approach}]   # from the grasp centre away from the hand, TCP frame
preshape: {{{p}_thumb_0: 1.3}}        # every other joint 0
fingers:                             # joints close in this order, all at the same speed
{fingers}
# The nine degrees of freedom of the real hand: joint = sum of coefficient * motor (iKin; pinky moves ring and little).
motor_limits:
  abduction: [0, 1.0472]
  thumb_opposition: [0.1745, 1.5707963]
  thumb_proximal: [0, 1.5707963]
  thumb_distal: [0, 2.9671]
  index_proximal: [0, 1.5707963]
  index_distal: [0, 2.9671]
  middle_proximal: [0, 1.5707963]
  middle_distal: [0, 2.9671]
  pinky: [0, 4.3633]
couplings:
  {p}_thumb_0: {{thumb_opposition: 1.0}}
  {p}_thumb_1: {{thumb_proximal: 1.0}}
  {p}_thumb_2: {{thumb_distal: 0.5}}
  {p}_thumb_3: {{thumb_distal: 0.5}}
  {p}_index_1: {{index_proximal: 1.0}}
  {p}_index_2: {{index_distal: 0.5}}
  {p}_index_3: {{index_distal: 0.5}}
  {p}_middle_1: {{middle_proximal: 1.0}}
  {p}_middle_2: {{middle_distal: 0.5}}
  {p}_middle_3: {{middle_distal: 0.5}}
  {p}_ring_1: {{pinky: 0.33333333}}
  {p}_ring_2: {{pinky: 0.33333333}}
  {p}_ring_3: {{pinky: 0.33333333}}
  {p}_little_1: {{pinky: 0.33333333}}
  {p}_little_2: {{pinky: 0.33333333}}
  {p}_little_3: {{pinky: 0.33333333}}
"""


def build_yaml(side: str) -> str:
    """Return the hand description that goes with the URDF."""
    p, sign = side[0], -1.0 if side == "left" else 1.0
    lines = []
    for finger in FINGERS:
        joints = ", ".join(f"{p}_{finger.name}_{index}" for index in (1, 2, 3))
        lines.append(f"  {finger.name}: {{joints: [{joints}]}}")
    return YAML_TEMPLATE.format(
        side=side,
        p=p,
        out=f"{sign:g}",
        gcp=f"{0.009 * sign:g}",
        approach=f"{0.70710678 * sign:.8g}",
        fingers="\n".join(lines),
    )


def main() -> None:
    """Write both hands into the folder given as the only argument."""
    folder = Path(sys.argv[1])
    for side in ("left", "right"):
        text = ElementTree.tostring(build_urdf(side), encoding="unicode")
        (folder / f"icub_{side}.urdf").write_text(f'<?xml version="1.0"?>\n{text}\n')
        (folder / f"icub_{side}.yaml").write_text(build_yaml(side))


if __name__ == "__main__":
    main()
