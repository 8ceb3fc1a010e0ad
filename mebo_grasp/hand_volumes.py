"""The room that a hand takes up in a grasp: what ``grasping`` knows of hands, in the terms of ``solutions``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import FloatArray, Grasp, HandPosture
from mebo_grasp.grasping.hand_model import HAND_NAMES, HandModel
from mebo_grasp.grasping.urdf import LinkShape, UrdfJoint
from mebo_grasp.solutions.hand_volume import HandVolume

STRIP = 0.015
"""Boxes are cut lengthwise into strips no wider than this, metres, and each is covered by a capsule: it sticks
out by less than half a strip at the sides and three quarters of one at the ends."""

SLICES = 5
"""Of the convex hull of a mesh, each covered by a sphere."""

Capsules = tuple[FloatArray, FloatArray, FloatArray]
"""Starts and ends, shape (m, 3), and radii, shape (m,), metres."""


def capsules_of(shape: LinkShape) -> Capsules:
    """Return capsules in the link's frame that together cover a link's shape.

    Spheres and capsules are themselves; a cylinder gets round caps; of a mesh the convex hull is covered.
    """
    if shape.kind in ("sphere", "capsule", "cylinder"):
        radius = shape.dims[0]
        half = shape.dims[1] / 2.0 if shape.kind != "sphere" else 0.0
        starts, ends, radii = np.array([[0, 0, -half]]), np.array([[0, 0, half]]), np.array([radius])
    elif shape.kind == "box":
        starts, ends, radii = _strips(np.array(shape.dims))
    else:
        starts, radii = _slices(np.asarray(shape.vertices))
        ends = starts
    T = np.asarray(shape.T_link_shape)
    return starts @ T[:3, :3].T + T[:3, 3], ends @ T[:3, :3].T + T[:3, 3], radii


def _strips(sides: FloatArray) -> Capsules:
    along = int(np.argmax(sides))
    counts = np.maximum(1, np.ceil(sides / STRIP).astype(int))
    counts[along] = 1
    axes = [sides[k] * ((np.arange(counts[k]) + 0.5) / counts[k] - 0.5) for k in range(3)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    widths = np.delete(sides / counts, along)
    half = np.zeros(3)
    half[along] = sides[along] / 2.0
    return middles - half, middles + half, np.full(len(middles), math.hypot(*widths) / 2.0)


def _slices(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut the hull of a mesh across its longest direction; return a sphere around each slice."""
    hull = ConvexHull(vertices)
    _, _, directions = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    heights = vertices @ directions[0]
    cuts = np.linspace(heights.min(), heights.max(), SLICES + 1)
    edges = np.concatenate([hull.simplices[:, [i, k]] for i, k in ((0, 1), (1, 2), (2, 0))])
    begin, end = heights[edges[:, 0]], heights[edges[:, 1]]
    # The corners of a slice: those of the hull between its two cuts, and where edges pass these cuts.
    corners = [vertices[hull.vertices]]
    for cut in cuts[1:-1]:
        passing = (begin - cut) * (end - cut) < 0.0
        t = ((cut - begin[passing]) / (end - begin)[passing])[:, None]
        corners.append((1.0 - t) * vertices[edges[passing, 0]] + t * vertices[edges[passing, 1]])
    points = np.concatenate(corners)
    height = points @ directions[0]
    rounding = 1e-9 + 1e-9 * np.abs(cuts).max()
    centers, radii = [], []
    for low, high in pairwise(cuts):
        part = points[(height >= low - rounding) & (height <= high + rounding)]
        center = (part.min(axis=0) + part.max(axis=0)) / 2.0
        centers.append(center)
        radii.append(float(np.linalg.norm(part - center, axis=1).max()) + rounding)
    return np.array(centers), np.array(radii)


class VolumeOfHand:
    """Tells the volume of one hand in any posture, in a tenth of a millisecond.

    Args:
        hand: the hand; its collision shapes count.

    Raises:
        InvalidHandError: the hand has no collision shape, or is too large for a volume in its preshape.
    """

    def __init__(self, hand: HandModel) -> None:
        if not hand.urdf.collisions:
            raise InvalidHandError(f"hand '{hand.name}' has no collision shapes, so no volume")
        self._hand = hand
        self._joints = hand.urdf.joints
        self._row = {hand.urdf.root: 0} | {joint.child: k + 1 for k, joint in enumerate(self._joints)}
        self._parents = [self._row[joint.parent] for joint in self._joints]
        self._fixed = np.array([joint.T_parent_joint for joint in self._joints]).reshape(-1, 4, 4)
        self._cross = np.array([_cross_matrix(joint) for joint in self._joints]).reshape(-1, 3, 3)
        self._cross_squared = self._cross @ self._cross
        description = hand.description
        self._tcp_row, self._T_link_tcp = self._row[description.tcp_link], description.T_link_tcp.matrix
        parts = [(self._row[shape.link], capsules_of(shape)) for shape in hand.urdf.collisions]
        self._links = np.repeat([row for row, _ in parts], [len(capsules[2]) for _, capsules in parts])
        starts, ends, self._radii = (np.concatenate([c[k] for _, c in parts]) for k in range(3))
        self._points = np.stack([starts, ends], axis=1)
        try:
            self(HandPosture())
        except InvalidHandError as error:
            # Told at once: of every grasp of such a hand the archive would refuse to keep it.
            raise InvalidHandError(f"hand '{hand.name}' has no volume: {error}") from error

    def __call__(self, posture: HandPosture) -> HandVolume:
        """Return the capsules in the TCP's frame; joints that the posture does not name keep the preshape.

        Raises:
            InvalidHandError: the posture names a joint that the hand does not have.
        """
        full = self._hand.posture(posture if posture.names else None)
        T_root = self._link_transforms(dict(zip(full.names, full.positions, strict=True)))
        T_tcp_root = np.linalg.inv(T_root[self._tcp_row] @ self._T_link_tcp)
        T = (T_tcp_root @ T_root)[self._links]
        points = self._points @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        return HandVolume(points[:, 0], points[:, 1], self._radii)

    def _link_transforms(self, values: dict[str, float]) -> FloatArray:
        """Return every link's pose in the root frame, shape (l, 4, 4): Rodrigues' formula joint by joint."""
        angles = np.array([values.get(joint.name, 0.0) if joint.movable else 0.0 for joint in self._joints])
        steps = self._fixed.copy()
        sine, versine = np.sin(angles)[:, None, None], (1.0 - np.cos(angles))[:, None, None]
        steps[:, :3, :3] = self._fixed[:, :3, :3] @ (np.eye(3) + sine * self._cross + versine * self._cross_squared)
        transforms = np.empty((len(self._joints) + 1, 4, 4))
        transforms[0] = np.eye(4)
        for k, parent in enumerate(self._parents):
            np.matmul(transforms[parent], steps[k], out=transforms[k + 1])
        return transforms


def _cross_matrix(joint: UrdfJoint) -> FloatArray:
    x, y, z = joint.axis if joint.movable else np.zeros(3)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class HandVolumes:
    """Tells the volume of the hand that made a grasp: a ``HandVolumeOf`` of ``solutions``.

    A grasp names its hand. Where that is a built-in hand, or one of those given, its volume in the final
    posture is told; for any other name the first hand stands in, in its preshape where the posture does
    not fit, and the name is passed on to ``on_unknown``.

    Args:
        hands: hands to be known by their names, at least one.
        on_unknown: called once for each name of a hand that is not known, with that name.
    """

    def __init__(self, hands: Sequence[HandModel], on_unknown: Callable[[str], None] = lambda _name: None) -> None:
        self._stand_in = VolumeOfHand(hands[0])
        self._known = {hand.name: VolumeOfHand(hand) for hand in hands}
        self._on_unknown = on_unknown
        self._unknown: set[str] = set()

    def __call__(self, grasp: Grasp) -> HandVolume:
        """Return the volume of a grasp's hand in the TCP's frame."""
        volume = self._volume_of(grasp.hand)
        if volume is not None:
            try:
                return volume(grasp.hand_posture)
            except InvalidHandError:
                self._report(f"{grasp.hand} (posture of another hand)")
                return volume(HandPosture())
        self._report(grasp.hand)
        try:
            return self._stand_in(grasp.hand_posture)
        except InvalidHandError:
            return self._stand_in(HandPosture())

    def _volume_of(self, name: str) -> VolumeOfHand | None:
        if name not in self._known and name in HAND_NAMES:
            self._known[name] = VolumeOfHand(HandModel.load(name))
        return self._known.get(name)

    def _report(self, name: str) -> None:
        if name not in self._unknown:
            self._unknown.add(name)
            self._on_unknown(name)
