"""``facet``: increments about a hand that faces a facet of the object's box (Nogueira's UBO paper, section V-B).

The default pose has the palm parallel to the facet, at a distance from which the bent fingers just do not reach it, the
middle of the fingers over the facet's middle, and the thumb on the side of a neighbouring facet. A candidate shifts
the hand from there and turns it. The paper closes along a power-grasp synergy; with ``synergy`` its amplitude is
the last dimension here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import check_bounds, checked_values, finger_length, finger_reach, within
from mebo_grasp.grasping.synergies import SynergyBasis, hand_synergies
from mebo_grasp.grasping.target_object import TargetObject

FloatArray = npt.NDArray[np.float64]

FACETS = ("+x", "-x", "+y", "-y", "+z", "-z")
INCREMENT_NAMES = ("along", "across", "towards", "roll", "pitch", "yaw")
SIDE_MARGIN = 0.05
"""By how much the lateral range exceeds the facet's side, metres (the paper's code)."""
ANGLE = np.pi / 4.0
"""Half range of the three angles, radians (the paper's code)."""
AMPLITUDES = (-3.0, 0.0)
"""Of the first synergy, standard deviations: from straight fingers to the mean of the closings. A hand bent further
meets the object before the palm is near: of random poses about the bottle none with an amplitude above 0 held it."""


@dataclass(frozen=True, eq=False)
class FacetSpace:
    """A box of increments about a default pose.

    Args:
        T_object_default: TCP pose that increments of 0 stand for.
        T_default_increment: rotation that turns increments into the TCP frame: along the fingers, across them, towards
            the facet; shape (3, 3).
        lower, upper: bounds, shape (6,) or (7,) with a synergy.
        hand: the hand.
        basis: synergies whose first amplitude is the last dimension, or None.

    Raises:
        InvalidSettingsError: bounds that are out of order or of the wrong number.
    """

    T_object_default: Pose
    T_default_increment: FloatArray
    lower: FloatArray
    upper: FloatArray
    hand: HandModel
    basis: SynergyBasis | None = None

    def __post_init__(self) -> None:
        for which in ("lower", "upper"):
            object.__setattr__(self, which, np.array(getattr(self, which), dtype=np.float64))
        check_bounds(self.names, self.lower, self.upper)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return INCREMENT_NAMES if self.basis is None else (*INCREMENT_NAMES, "synergy_1")

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each dimension."""
        return ("m", "m", "m", "rad", "rad", "rad", "sd")[: len(self.names)]

    @property
    def dimension(self) -> int:
        """Number of dimensions."""
        return len(self.names)

    def to_pose(self, x: npt.ArrayLike) -> Pose:
        """Return the TCP pose of a candidate, shape (d,), in the object's frame.

        Raises:
            InvalidSettingsError: wrong number of values.
            InvalidPoseError: a value is not finite.
        """
        values = checked_values(x, self.names)
        shift = self.T_default_increment @ values[:3]
        return self.T_object_default @ Pose.from_rpy(shift, values[3:6])

    def to_posture(self, x: npt.ArrayLike) -> HandPosture:
        """Return the posture in which the hand arrives: that of the synergy's amplitude, or the preshape."""
        values = checked_values(x, self.names)
        return self.hand.preshape if self.basis is None else self.basis.posture(self.hand, values[6:])

    def from_pose(self, pose: Pose, posture: HandPosture | None = None) -> FloatArray:
        """Return the candidate that stands for a pose and, with a synergy, a posture; shape (d,)."""
        increment = self.T_object_default.inverse() @ pose
        values = np.concatenate([self.T_default_increment.T @ increment.position, increment.rpy])
        if self.basis is None:
            return values
        amplitude = self.basis.amplitudes(posture or self.hand.preshape)[:1]
        return np.concatenate([values, amplitude])

    def contains(self, x: npt.ArrayLike, slack: float = 1e-9) -> bool:
        """Whether a candidate lies within the bounds."""
        return within(x, self.lower, self.upper, slack)


def facet_axes(facet: str, fingers: str | None) -> tuple[FloatArray, FloatArray]:
    """Return the outward normal of a facet and the direction of the fingers, each (3,).

    Args:
        facet: one of ``FACETS``.
        fingers: one of ``FACETS`` across the facet; None: +x, or +y for the facets of x.

    Raises:
        InvalidSettingsError: unknown names, or fingers that point into or out of the facet.
    """
    chosen = fingers or ("+y" if facet.endswith("x") else "+x")
    for what, name in (("facet", facet), ("fingers", chosen)):
        if name not in FACETS:
            raise InvalidSettingsError(f"{what} is '{name}'; it must be one of {', '.join(FACETS)}")
    if facet[1] == chosen[1]:
        raise InvalidSettingsError(f"fingers along '{chosen}' do not lie in the facet '{facet}'; give another axis")
    axes = {name: (1.0 if name[0] == "+" else -1.0) * np.eye(3)["xyz".index(name[1])] for name in FACETS}
    return axes[facet], axes[chosen]


def facet_space(
    target: TargetObject,
    hand: HandModel,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    facet: str = "+y",
    fingers: str | None = None,
    synergy: bool = False,
) -> FacetSpace:
    """Return the space of increments about a hand in front of a facet.

    Along and across the fingers the range is the facet's side and 5 cm more, towards the facet from the default
    distance to the palm at the facet, and 45 degrees either way for the angles.

    Args:
        target: the object.
        hand: the hand; its TCP's x axis is along the fingers.
        lower: lower bounds that override these, shape (d,).
        upper: the same for the upper ones.
        facet: outward direction of the facet.
        fingers: direction in which the stretched fingers point; the thumb then lies on the side that is left over.
        synergy: whether the amplitude of the first synergy is a dimension.

    Raises:
        InvalidSettingsError: unknown facets, or bounds out of order.
        InvalidHandError: a synergy is asked of a hand that has none.
    """
    normal, along = facet_axes(facet, fingers)
    palm_normal = hand.palm_normal
    # The TCP's x axis goes along the fingers, and the palm's normal, made square to it, against the facet's.
    palm = palm_normal - palm_normal[0] * np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(palm) < 0.5:
        raise InvalidSettingsError(
            f"the palm of hand '{hand.name}' faces along its fingers; set tcp.rpy so that x is along the fingers"
        )
    palm = palm / np.linalg.norm(palm)
    in_tcp = np.column_stack([[1.0, 0.0, 0.0], np.cross(palm, [1.0, 0.0, 0.0]), palm])
    in_object = np.column_stack([along, np.cross(-normal, along), -normal])
    R = in_object @ in_tcp.T
    low, high = target.bounds
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    reach = finger_reach(hand)
    on_facet = middle + normal * float(np.abs(normal) @ half)
    position = on_facet + normal * reach - along * 0.5 * finger_length(hand)
    sides = [float(np.abs(axis) @ half) + SIDE_MARGIN / 2.0 for axis in (along, in_object[:, 1])]
    own_lower = np.array([-sides[0], -sides[1], 0.0, -ANGLE, -ANGLE, -ANGLE])
    own_upper = np.array([sides[0], sides[1], reach, ANGLE, ANGLE, ANGLE])
    if synergy:
        own_lower, own_upper = np.append(own_lower, AMPLITUDES[0]), np.append(own_upper, AMPLITUDES[1])
    return FacetSpace(
        Pose(position, Rotation.from_matrix(R).as_quat()),
        in_tcp,
        own_lower if lower is None else np.asarray(lower, dtype=np.float64),
        own_upper if upper is None else np.asarray(upper, dtype=np.float64),
        hand,
        hand_synergies(hand) if synergy else None,
    )
