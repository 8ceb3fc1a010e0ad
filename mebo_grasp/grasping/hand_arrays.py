"""A hand flattened into arrays for the compiled closing loop.

Groups are rigid bodies: group ``f * MOST_JOINTS + j`` moves with closing joint j of finger f, group
``fingers * MOST_JOINTS`` is everything that keeps still while the hand closes (palm, thumb base).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import HandPosture
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.shape_cover import SHAPES_REMEMBERED, covering_spheres
from mebo_grasp.grasping.urdf import LinkShape, UrdfJoint

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_FINGERS = 6
MOST_JOINTS = 4
MOST_GROUPS = MOST_FINGERS * MOST_JOINTS + 1
MOST_SHAPES = 64
MOST_SPHERES = 1024
ROUND, BOX = 0, 1
FREE_AT_START = 1e-4
"""Pairs of links nearer than this in the preshape are never tested against each other, metres."""
APART_FOR_GOOD = 1e-3
"""Fingers whose slabs keep so far apart are not tested against each other, metres."""


HAND_TYPE = np.dtype(
    [
        ("fingers", np.int64),
        ("shapes", np.int64),
        ("joint_count", np.int64, (MOST_FINGERS,)),
        ("fixed", np.float64, (MOST_FINGERS, MOST_JOINTS, 4, 4)),
        ("axis", np.float64, (MOST_FINGERS, MOST_JOINTS, 3)),
        ("speed", np.float64, (MOST_FINGERS, MOST_JOINTS)),
        ("lower", np.float64, (MOST_FINGERS, MOST_JOINTS)),
        ("upper", np.float64, (MOST_FINGERS, MOST_JOINTS)),
        ("start", np.float64, (MOST_FINGERS, MOST_JOINTS)),
        ("shape_group", np.int64, (MOST_SHAPES,)),
        ("group_shapes", np.int64, (MOST_GROUPS + 1,)),
        ("ends", np.float64, (MOST_SHAPES, 2, 3)),
        ("radius", np.float64, (MOST_SHAPES,)),
        ("kind", np.int64, (MOST_SHAPES,)),
        ("box", np.float64, (MOST_SHAPES, 4, 3)),
        ("ball", np.float64, (MOST_SHAPES,)),
        ("sphere_start", np.int64, (MOST_SHAPES + 1,)),
        ("sphere_center", np.float64, (MOST_SPHERES, 3)),
        ("sphere_radius", np.float64, (MOST_SPHERES,)),
        ("reach", np.float64, (MOST_SHAPES, MOST_JOINTS)),
        ("pair_start", np.int64, (MOST_SHAPES + 1,)),
        ("pair_other", np.int64, (MOST_SHAPES * MOST_SHAPES,)),
        ("slab_normal", np.float64, (MOST_FINGERS, 3)),
        ("slab", np.float64, (MOST_FINGERS, 2)),
    ],
    align=True,
)
"""Chains, shapes and self-collision pairs of a hand; see the module's text for groups.

A record rather than a tuple of arrays: compiled functions then pass one pointer and count no references.

fingers, shapes: how many there are; arrays are as long as the most that are taken
joint_count: closing joints of each finger
fixed: pose of each joint frame in the frame before it (the first: in the TCP frame)
axis: unit joint axes
speed: relative closing speeds
lower, upper, start: limits and preshape, radians
shape_group: group of each shape; shapes are sorted by group
group_shapes: first shape of each group
ends: capsule axis ends in the group frame; a sphere has both equal; a box its centre twice
radius: capsule radius; 0 for a box
kind: ROUND or BOX
box: axes of a box in the group frame as rows, then its half sides
ball: radius of a sphere about the middle of the ends that holds the shape
sphere_start: first covering sphere of each shape
sphere_center, sphere_radius: covering spheres, group frame
reach: bound on the distance of a shape's points from joint j of its finger
pair_start, pair_other: partners of each shape in tests of the hand against itself, those of the palm last
slab_normal: common direction of a finger's joint axes, TCP frame
slab: range along it that the finger's shapes never leave; infinite if the axes are not parallel
"""

HandArrays: TypeAlias = Any
"""A record of ``HAND_TYPE``."""


class HandLayout(NamedTuple):
    """What the arrays mean: the shape behind each row, its pose in its group, and the joint of each (f, j)."""

    shapes: tuple[LinkShape, ...]
    T_group_shape: FloatArray
    joints: tuple[tuple[str, ...], ...]


def build_hand_arrays(hand: HandModel, posture: HandPosture) -> tuple[HandArrays, HandLayout]:
    """Flatten a hand whose joints other than the closing ones stand at ``posture``.

    Raises:
        InvalidHandError: more fingers, closing joints or shapes than are taken, or no shape that can collide.
    """
    chains = [finger.joints for finger in hand.fingers]
    values = dict(zip(posture.names, posture.positions, strict=True))
    groups, poses = _rigid_groups(hand, values)
    static = len(chains) * MOST_JOINTS
    order = sorted(hand.urdf.collisions, key=lambda shape: groups[shape.link])
    check_sizes(hand, len(order))
    T = np.array([poses[shape.link] @ shape.T_link_shape for shape in order])
    shape_group = np.array([groups[shape.link] for shape in order])
    fields: dict[str, npt.NDArray[Any]] = _chain_fields(hand, values, poses)
    fields |= _sphere_fields(hand, order, T) | _self_fields(order, T)
    fields["shape_group"] = shape_group
    fields["group_shapes"] = np.searchsorted(shape_group, np.arange(static + 2))
    fields["reach"] = _reaches(fields, shape_group, static)
    fields["pair_start"], fields["pair_other"] = _pairs(shape_group, static)
    fields["slab_normal"], fields["slab"] = _slabs(fields, shape_group)
    arrays = np.zeros(1, HAND_TYPE)
    for name, value in fields.items():
        arrays[name][0][tuple(slice(n) for n in value.shape)] = value
    arrays["fingers"], arrays["shapes"] = len(chains), len(order)
    return arrays[0], HandLayout(tuple(order), T, tuple(chains))


def check_sizes(hand: HandModel, shapes: int) -> None:
    """Check that a hand fits into the arrays.

    Raises:
        InvalidHandError: naming what is too many.
    """
    longest = max(len(finger.joints) for finger in hand.fingers)
    for what, count, most in (
        ("fingers", len(hand.fingers), MOST_FINGERS),
        ("closing joints in a finger", longest, MOST_JOINTS),
        ("collision shapes", shapes, MOST_SHAPES),
    ):
        if not 0 < count <= most:
            raise InvalidHandError(f"hand '{hand.name}' has {count} {what}; at least 1 and at most {most} are taken")


def _rigid_groups(hand: HandModel, values: dict[str, float]) -> tuple[dict[str, int], dict[str, FloatArray]]:
    """Return each link's group, and its pose in the frame of that group."""
    closing = {
        joint: f * MOST_JOINTS + j for f, finger in enumerate(hand.fingers) for j, joint in enumerate(finger.joints)
    }
    T_tcp = hand.link_transforms(HandPosture(tuple(values), tuple(values.values())))
    root = hand.urdf.root
    static = len(hand.fingers) * MOST_JOINTS
    groups, poses = {root: static}, {root: T_tcp[root]}
    for joint in hand.urdf.joints:
        if joint.name in closing:
            groups[joint.child], poses[joint.child] = closing[joint.name], np.eye(4)
        else:
            groups[joint.child] = groups[joint.parent]
            poses[joint.child] = poses[joint.parent] @ _joint_pose(joint, values.get(joint.name, 0.0))
    return groups, poses


def _joint_pose(joint: UrdfJoint, value: float) -> FloatArray:
    T = joint.T_parent_joint.copy()
    if joint.movable:
        c, s = np.cos(value), np.sin(value)
        x, y, z = joint.axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        T[:3, :3] = T[:3, :3] @ (np.eye(3) + s * K + (1.0 - c) * (K @ K))
    return T


def _chain_fields(hand: HandModel, values: dict[str, float], poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
    F = len(hand.fingers)
    fields = {name: np.zeros((F, MOST_JOINTS)) for name in ("speed", "lower", "upper", "start")}
    fields["joint_count"] = np.array([len(finger.joints) for finger in hand.fingers])
    fields["fixed"] = np.tile(np.eye(4), (F, MOST_JOINTS, 1, 1))
    fields["axis"] = np.tile([0.0, 0.0, 1.0], (F, MOST_JOINTS, 1))
    for f, finger in enumerate(hand.fingers):
        for j, name in enumerate(finger.joints):
            joint = hand.urdf.joint(name)
            fields["fixed"][f, j] = poses[joint.parent] @ joint.T_parent_joint
            fields["axis"][f, j], fields["speed"][f, j] = joint.axis, finger.speeds[j]
            fields["lower"][f, j], fields["upper"][f, j] = joint.lower, joint.upper
            fields["start"][f, j] = values[name]
    return fields


def _sphere_fields(hand: HandModel, shapes: list[LinkShape], T: FloatArray) -> dict[str, FloatArray]:
    spheres = [covering_spheres(shape, T[i]) for i, shape in enumerate(shapes)]
    start = np.concatenate([[0], np.cumsum([len(radii) for _, radii in spheres])])
    if start[-1] > MOST_SPHERES:
        raise InvalidHandError(
            f"hand '{hand.name}' needs {start[-1]} spheres to cover its shapes, at most {MOST_SPHERES} are taken; "
            "describe large links by fewer or smaller shapes, and look whether millimetres are taken for metres"
        )
    return {
        "sphere_start": start,
        "sphere_center": np.vstack([center for center, _ in spheres]),
        "sphere_radius": np.concatenate([radius for _, radius in spheres]),
    }


def _self_fields(shapes: list[LinkShape], T: FloatArray) -> dict[str, FloatArray]:
    """Return the shapes as capsules and boxes for tests of the hand against itself."""
    n = len(shapes)
    ends, radius = np.zeros((n, 2, 3)), np.zeros(n)
    kind, box = np.zeros(n, dtype=np.int64), np.zeros((n, 4, 3))
    for i, shape in enumerate(shapes):
        ends[i] = T[i, :3, 3]
        if shape.kind == "sphere":
            radius[i] = shape.dims[0]
        elif shape.kind == "box":
            kind[i] = BOX
            box[i, :3], box[i, 3] = T[i, :3, :3].T, np.array(shape.dims) / 2.0
        else:
            half, radius[i], middle = _capsule_of(shape)
            ends[i] = [
                T[i, :3, :3] @ (middle - half) + T[i, :3, 3],
                T[i, :3, :3] @ (middle + half) + T[i, :3, 3],
            ]
    ball = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2.0 + radius + np.linalg.norm(box[:, 3], axis=1)
    return {"ends": ends, "radius": radius, "kind": kind, "box": box, "ball": ball}


@lru_cache(SHAPES_REMEMBERED)
def _capsule_of(shape: LinkShape) -> tuple[FloatArray, float, FloatArray]:
    """Return half axis, radius and centre of a capsule that stands for a shape in its own frame."""
    if shape.kind == "capsule":
        return np.array([0.0, 0.0, shape.dims[1] / 2.0]), shape.dims[0], np.zeros(3)
    if shape.kind == "cylinder":
        half = max(shape.dims[1] / 2.0 - shape.dims[0], 0.0)
        return np.array([0.0, 0.0, half]), shape.dims[0], np.zeros(3)
    vertices = np.asarray(shape.vertices)
    middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2.0
    _, _, directions = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    along = (vertices - middle) @ directions[0]
    across = np.linalg.norm((vertices - middle) - np.outer(along, directions[0]), axis=1)
    radius = float(np.percentile(across, 50.0))
    return directions[0] * max(float(np.ptp(along)) / 2.0 - radius, 0.0), radius, middle


def _reaches(fields: dict[str, FloatArray], shape_group: IntArray, static: int) -> FloatArray:
    """Bound how far each shape's points get from each joint of its finger, whatever the joint values."""
    reach = np.zeros((len(shape_group), MOST_JOINTS))
    for i, group in enumerate(shape_group):
        if group == static:
            continue
        f, last = divmod(int(group), MOST_JOINTS)
        part = slice(fields["sphere_start"][i], fields["sphere_start"][i + 1])
        distances = np.linalg.norm(fields["sphere_center"][part], axis=1) + fields["sphere_radius"][part]
        length = float(distances.max())
        for j in range(last, -1, -1):
            reach[i, j] = length
            length += float(np.linalg.norm(fields["fixed"][f, j, :3, 3]))
    return reach


def _slabs(fields: dict[str, FloatArray], shape_group: IntArray) -> tuple[FloatArray, FloatArray]:
    """Find the slab that each finger moves in: joints with parallel axes keep all points' height along them."""
    counts, fixed, axis = fields["joint_count"], fields["fixed"], fields["axis"]
    ends, radius, kind = fields["ends"], fields["radius"], fields["kind"]
    F = len(counts)
    normals, slabs = np.tile([0.0, 0.0, 1.0], (F, 1)), np.tile([-np.inf, np.inf], (F, 1))
    for f in range(F):
        T, heights, parallel = np.eye(4), [], True
        normals[f] = fixed[f, 0, :3, :3] @ axis[f, 0]
        for j in range(counts[f]):
            T = T @ fixed[f, j]
            parallel = parallel and bool(np.allclose(T[:3, :3] @ axis[f, j], normals[f], atol=1e-7))
            for shape in np.flatnonzero(shape_group == f * MOST_JOINTS + j):
                parallel = parallel and kind[shape] == ROUND
                along = (ends[shape] @ T[:3, :3].T + T[:3, 3]) @ normals[f]
                heights += [along.min() - radius[shape], along.max() + radius[shape]]
        if parallel and heights:
            slabs[f] = min(heights) - 1e-6, max(heights) + 1e-6
    return normals, slabs


def _pairs(shape_group: IntArray, static: int) -> tuple[IntArray, IntArray]:
    """Say which shapes are tested against each other: links of different fingers, and outer links against the rest.

    The first closing link of a finger always overlaps its base, so it is tested against other fingers only.
    """
    start: list[int] = [0]
    others: list[int] = []
    for group in shape_group:
        f, j = divmod(int(group), MOST_JOINTS)
        for k, other_group in enumerate(shape_group):
            if group == static:
                continue
            if (other_group == static and j >= 1) or (other_group != static and int(other_group) // MOST_JOINTS != f):
                others.append(k)
        start.append(len(others))
    return np.array(start, dtype=np.int64), np.array(others, dtype=np.int64)


def never_meeting_pairs(hand: HandArrays) -> set[tuple[int, int]]:
    """Return the pairs of shapes whose fingers cannot meet: each keeps to its slab and near its first joint."""
    pairs = set()
    fingers, group = int(hand["fingers"]), hand["shape_group"][: int(hand["shapes"])] // MOST_JOINTS
    for f in np.flatnonzero(np.isfinite(hand["slab"][:fingers]).all(axis=1)):
        base, normal = hand["fixed"][f, 0, :3, 3], hand["slab_normal"][f]
        # Heights along the finger's own normal, counted from its first joint, and the farthest from that joint.
        low, high = hand["slab"][f] - normal @ base
        reach = float(hand["reach"][: len(group), 0][group == f].max(initial=0.0))
        for g in range(fingers):
            across = float(hand["slab_normal"][g] @ normal)
            lean = reach * np.sqrt(max(1.0 - across * across, 0.0))
            middle = hand["slab_normal"][g] @ base
            ends = sorted((low * across, high * across))
            below = hand["slab"][g, 0] - (middle + ends[1] + lean)
            above = middle + ends[0] - lean - hand["slab"][g, 1]
            if f != g and max(below, above) > APART_FOR_GOOD:
                pairs |= {(int(i), int(k)) for i in np.flatnonzero(group == f) for k in np.flatnonzero(group == g)}
    return pairs | {(k, i) for i, k in pairs}


def drop_pairs(hand: HandArrays, touching: set[tuple[int, int]]) -> None:
    """Exempt some pairs of shapes from the test of the hand against itself."""
    start: list[int] = [0]
    others: list[int] = []
    for shape in range(int(hand["shapes"])):
        partners = hand["pair_other"][hand["pair_start"][shape] : hand["pair_start"][shape + 1]]
        others += [int(other) for other in partners if (shape, int(other)) not in touching]
        start.append(len(others))
    hand["pair_start"][: len(start)] = start
    hand["pair_other"][: len(others)] = others
