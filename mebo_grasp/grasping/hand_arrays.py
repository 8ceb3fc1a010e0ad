"""A hand flattened into arrays for the compiled closing loop.

Groups are rigid bodies: group ``f * MOST_JOINTS + j`` moves with closing joint j of finger f, group
``STATIC = F * MOST_JOINTS`` is everything that keeps still while the hand closes (palm, thumb base).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import HandPosture
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.shape_cover import covering_spheres
from mebo_grasp.grasping.urdf import LinkShape, UrdfJoint

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_JOINTS = 4
ROUND, BOX = 0, 1
FREE_AT_START = 1e-4
"""Pairs of links nearer than this in the preshape are never tested against each other, metres."""


_Chains = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""The first seven attributes of ``HandArrays``."""


class HandArrays(NamedTuple):
    """Chains, shapes and self-collision pairs; see the module's text for groups.

    Attributes:
        joint_count: (F,) closing joints of each finger.
        fixed: (F, J, 4, 4) pose of each joint frame in the frame before it (the first: in the TCP frame).
        axis: (F, J, 3) unit joint axes.
        speed: (F, J) relative closing speeds.
        lower, upper: (F, J) limits, radians.
        start: (F, J) values in the preshape, radians.
        shape_group: (P,) group of each shape.
        group_shapes: (G + 1,) first shape of each group; shapes are sorted by group.
        ends: (P, 2, 3) capsule axis ends in the group frame; a sphere has both equal; a box its centre twice.
        radius: (P,) capsule radius; 0 for a box.
        kind: (P,) ROUND or BOX.
        box: (P, 4, 3) rotation rows and half sides of a box.
        sphere_start: (P + 1,) first covering sphere of each shape.
        sphere_center: (S, 3) group frame.
        sphere_radius: (S,)
        reach: (P, J) bound on the distance of a shape's points from the axis of joint j of its finger.
        ball: (P,) radius of a sphere about the middle of the ends that holds the shape.
        pair_start: (P + 1,) first of each shape's partners in tests of the hand against itself.
        pair_other: those partners.
        slab_normal: (F, 3) common direction of a finger's joint axes, TCP frame.
        slab: (F, 2) range along it that the finger's shapes never leave; infinite if the axes are not parallel.
    """

    joint_count: IntArray
    fixed: FloatArray
    axis: FloatArray
    speed: FloatArray
    lower: FloatArray
    upper: FloatArray
    start: FloatArray
    shape_group: IntArray
    group_shapes: IntArray
    ends: FloatArray
    radius: FloatArray
    kind: IntArray
    box: FloatArray
    sphere_start: IntArray
    sphere_center: FloatArray
    sphere_radius: FloatArray
    reach: FloatArray
    ball: FloatArray
    pair_start: IntArray
    pair_other: IntArray
    slab_normal: FloatArray
    slab: FloatArray


class HandLayout(NamedTuple):
    """What the arrays mean: the shape behind each row, its pose in its group, and the joint of each (f, j)."""

    shapes: tuple[LinkShape, ...]
    T_group_shape: FloatArray
    joints: tuple[tuple[str, ...], ...]


def build_hand_arrays(hand: HandModel, posture: HandPosture) -> tuple[HandArrays, HandLayout]:
    """Flatten a hand whose joints other than the closing ones stand at ``posture``.

    Raises:
        InvalidHandError: a chain has more than ``MOST_JOINTS`` closing joints, or no shape can collide.
    """
    chains = [finger.joints for finger in hand.fingers]
    longest = max(len(chain) for chain in chains)
    if longest > MOST_JOINTS:
        raise InvalidHandError(
            f"hand '{hand.name}': a finger closes {longest} joints, at most {MOST_JOINTS} are taken"
        )
    values = dict(zip(posture.names, posture.positions, strict=True))
    groups, poses = _rigid_groups(hand, values)
    static = len(chains) * MOST_JOINTS
    order = sorted(hand.urdf.collisions, key=lambda shape: groups[shape.link])
    if not order:
        raise InvalidHandError(f"hand '{hand.name}' has no collision shapes")
    T = np.array([poses[shape.link] @ shape.T_link_shape for shape in order])
    shape_group = np.array([groups[shape.link] for shape in order])
    chain_data = _chain_arrays(hand, values)
    spheres = [covering_spheres(shape, T[i]) for i, shape in enumerate(order)]
    counts = [len(radii) for _, radii in spheres]
    centers = np.vstack([center for center, _ in spheres])
    radii = np.concatenate([radius for _, radius in spheres])
    sphere_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    ends, radius, kind, box = _self_shapes(order, T)
    arrays = HandArrays(
        *chain_data,
        shape_group.astype(np.int64),
        np.searchsorted(shape_group, np.arange(static + 2)).astype(np.int64),
        ends,
        radius,
        kind,
        box,
        sphere_start,
        centers,
        radii,
        _reaches(chain_data[1], shape_group, centers, radii, sphere_start, static),
        np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2.0 + radius + np.linalg.norm(box[:, 3], axis=1),
        *_pairs(shape_group, static),
        *_slabs(chain_data, shape_group, ends, radius, kind),
    )
    return arrays, HandLayout(tuple(order), T, tuple(chains))


def _rigid_groups(hand: HandModel, values: dict[str, float]) -> tuple[dict[str, int], dict[str, FloatArray]]:
    """Return each link's group, and its pose in the frame of that group."""
    closing = {
        joint: f * MOST_JOINTS + j
        for f, finger in enumerate(hand.fingers)
        for j, joint in enumerate(finger.joints)
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


def _chain_arrays(hand: HandModel, values: dict[str, float]) -> _Chains:
    F = len(hand.fingers)
    counts = np.array([len(finger.joints) for finger in hand.fingers], dtype=np.int64)
    fixed = np.tile(np.eye(4), (F, MOST_JOINTS, 1, 1))
    axis = np.tile([0.0, 0.0, 1.0], (F, MOST_JOINTS, 1))
    speed, lower, upper, start = (np.zeros((F, MOST_JOINTS)) for _ in range(4))
    _, poses = _rigid_groups(hand, values)
    for f, finger in enumerate(hand.fingers):
        for j, name in enumerate(finger.joints):
            joint = hand.urdf.joint(name)
            fixed[f, j] = poses[joint.parent] @ joint.T_parent_joint
            axis[f, j] = joint.axis
            speed[f, j] = finger.speeds[j]
            lower[f, j], upper[f, j], start[f, j] = joint.lower, joint.upper, values[name]
    return counts, fixed, axis, speed, lower, upper, start


def _self_shapes(
    shapes: list[LinkShape], T: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
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
    return ends, radius, kind, box


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


def _reaches(
    fixed: FloatArray,
    shape_group: IntArray,
    centers: FloatArray,
    radii: FloatArray,
    sphere_start: IntArray,
    static: int,
) -> FloatArray:
    """Bound how far each shape's points get from each joint of its finger, whatever the joint values."""
    reach = np.zeros((len(shape_group), MOST_JOINTS))
    for i, group in enumerate(shape_group):
        if group == static:
            continue
        f, last = divmod(int(group), MOST_JOINTS)
        part = slice(sphere_start[i], sphere_start[i + 1])
        length = float((np.linalg.norm(centers[part], axis=1) + radii[part]).max())
        for j in range(last, -1, -1):
            reach[i, j] = length
            length += float(np.linalg.norm(fixed[f, j, :3, 3]))
    return reach


def _slabs(
    chains: _Chains, shape_group: IntArray, ends: FloatArray, radius: FloatArray, kind: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Find the slab that each finger moves in: joints with parallel axes keep all points' height along them."""
    counts, fixed, axis = chains[:3]
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
    start, others = [0], []
    for group in shape_group:
        f, j = divmod(int(group), MOST_JOINTS)
        for k, other_group in enumerate(shape_group):
            if group == static:
                continue
            if (other_group == static and j >= 1) or (
                other_group != static and int(other_group) // MOST_JOINTS != f
            ):
                others.append(k)
        start.append(len(others))
    return np.array(start, dtype=np.int64), np.array(others, dtype=np.int64)


def without_pairs(hand: HandArrays, touching: list[tuple[int, int]]) -> HandArrays:
    """Return the hand with some pairs of shapes exempted from the test of the hand against itself."""
    start: list[int] = [0]
    others: list[int] = []
    for shape in range(len(hand.shape_group)):
        partners = hand.pair_other[hand.pair_start[shape] : hand.pair_start[shape + 1]]
        others.extend(int(other) for other in partners if (shape, int(other)) not in touching)
        start.append(len(others))
    return hand._replace(
        pair_start=np.array(start, dtype=np.int64), pair_other=np.array(others, dtype=np.int64)
    )
