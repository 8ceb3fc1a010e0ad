"""Grasps as columns, what is known of a node of them, and a question: what the compiled search works on."""

from __future__ import annotations

from typing import NamedTuple

from mebo_grasp.grasp import FloatArray
from mebo_grasp.solutions.diversity import IntArray
from mebo_grasp.solutions.hand_volume import PackedVolume


class Grasps(NamedTuple):
    """n grasps with a quality above zero, as columns.

    Args:
        order: rows leaf by leaf of the tree, then those that are in no tree; each leaf and the rest are
            sorted by quality, equal ones by stamp; shape (n,).
        stamps: shape (n,), nanoseconds.
        qualities: shape (n,).
        positions: of the TCP in the object's frame, shape (n, 3), metres.
        quaternions: xyzw, shape (n, 4).
        points: one point of each hand, by which the tree orders them, shape (n, 3), metres.
        inner: radius about that point within which all is hand, shape (n,); 0 under the TCP rule.
        outer: radius about that point outside of which is neither hand nor TCP, shape (n,); 0 under the
            TCP rule.
        first_capsule: capsules of grasp i are the rows ``first_capsule[i]`` to ``first_capsule[i + 1]``,
            shape (n + 1,).
        capsules: in the TCP's frame, shape (c, 7).
    """

    order: IntArray
    stamps: IntArray
    qualities: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    points: FloatArray
    inner: FloatArray
    outer: FloatArray
    first_capsule: IntArray
    capsules: PackedVolume


class NodeBounds(NamedTuple):
    """Least and greatest values over the grasps of each of k nodes, each of shape (k,)."""

    best: FloatArray
    worst: FloatArray
    inner: FloatArray
    outer: FloatArray


class Wanted(NamedTuple):
    """A question to the index.

    Args:
        number: how many grasps at most, at least 1.
        min_quality: least quality.
        min_distance: least mutual distance, metres.
        rotation_weight: of the distance between poses, metres a radian.
        symmetry_axis: of the distance between poses, shape (3,), unit or zero.
        by_hand: whether the hand's volume counts instead of the TCP.
        approach: where the approach begins, in the TCP's frame, shape (3,), metres; zero for none.
    """

    number: int
    min_quality: float
    min_distance: float
    rotation_weight: float
    symmetry_axis: FloatArray
    by_hand: bool
    approach: FloatArray
