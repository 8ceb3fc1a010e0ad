"""Search spaces: which numbers describe a candidate, within which bounds, and what pose they stand for.

The hand approaches the object from +y with its palm facing it and its fingers along +x, as in the thesis
(section 7.4): roll -90 degrees for the left hand, +90 for the right one, whose frame is mirrored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.shape_cover import covering_spheres
from mebo_grasp.grasping.target_object import TargetObject

FloatArray = npt.NDArray[np.float64]

POSITION_NAMES = ("x", "y", "z")
ROTATION_NAMES = ("roll", "pitch", "yaw")
SLICES = 40
DEFAULT_ROTATION_SPAN = (0.5, 0.4, 0.7)
"""Half ranges of roll, pitch and yaw about the side approach, radians."""


def distance_weights(units: Sequence[str], rotation_weight: float) -> FloatArray:
    """Return what a unit of each dimension counts in the distance of two candidates, shape (d,).

    Args:
        units: one a dimension. Metres count fully, and what is no length nor angle (a posture) not at all, as in
            the distance of two grasps.
        rotation_weight: metres that a radian counts.
    """
    return np.array([{"m": 1.0, "rad": rotation_weight}.get(unit, 0.0) for unit in units])


def checked_values(x: npt.ArrayLike, names: tuple[str, ...]) -> FloatArray:
    """Return a candidate as an array, one value a dimension of its space.

    Raises:
        InvalidSettingsError: wrong number of values.
    """
    values = np.asarray(x, dtype=np.float64)
    if values.shape != (len(names),):
        raise InvalidSettingsError(
            f"a candidate of this space has {len(names)} values ({', '.join(names)}), "
            f"got an array of shape {values.shape}"
        )
    return values


def within(x: npt.ArrayLike, lower: FloatArray, upper: FloatArray, slack: float) -> bool:
    """Whether a candidate lies within bounds widened by ``slack``."""
    values = np.asarray(x, dtype=np.float64)
    return bool(np.all(values >= lower - slack) and np.all(values <= upper + slack))


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """A box of candidates and the pose of the TCP in the object's frame that each stands for.

    Args:
        names: names of the dimensions; of x, y, z, roll, pitch, yaw, those that vary.
        units: unit of each dimension.
        lower, upper: bounds, shape (d,).
        base_position: values of the dimensions that do not vary, shape (3,), metres.
        base_rpy: the same for roll, pitch, yaw, shape (3,), radians.

    Raises:
        InvalidSettingsError: bounds are not finite, in the wrong order or of the wrong length.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    base_position: FloatArray
    base_rpy: FloatArray

    def __post_init__(self) -> None:
        for which in ("lower", "upper", "base_position", "base_rpy"):
            object.__setattr__(self, which, np.array(getattr(self, which), dtype=np.float64))
        known = (*POSITION_NAMES, *ROTATION_NAMES)
        if not self.names or len(set(self.names)) != len(self.names) or any(name not in known for name in self.names):
            raise InvalidSettingsError(f"dimensions {self.names} must be some of {known}, each once")
        check_bounds(self.names, self.lower, self.upper)

    @property
    def dimension(self) -> int:
        """Number of dimensions."""
        return len(self.names)

    def to_pose(self, x: npt.ArrayLike) -> Pose:
        """Return the pose of a candidate.

        Args:
            x: shape (d,), in the units of the space; not clipped to the bounds.

        Raises:
            InvalidSettingsError: wrong number of values.
            InvalidPoseError: a value is not finite.
        """
        values = checked_values(x, self.names)
        full = np.concatenate([self.base_position, self.base_rpy])
        full[self._indices] = values
        return Pose.from_rpy(full[:3], full[3:])

    def from_pose(self, pose: Pose) -> FloatArray:
        """Return the candidate nearest in meaning to a pose, shape (d,): its own position and angles.

        Angles are brought to within half a turn of the middle of their range; fixed dimensions are dropped.
        """
        angles = self._nearest_angles(pose)
        return np.concatenate([pose.position, angles])[self._indices]

    def contains(self, x: npt.ArrayLike, slack: float = 1e-9) -> bool:
        """Whether a candidate lies within the bounds."""
        return within(x, self.lower, self.upper, slack)

    @property
    def _indices(self) -> list[int]:
        return [(*POSITION_NAMES, *ROTATION_NAMES).index(name) for name in self.names]

    def _nearest_angles(self, pose: Pose) -> FloatArray:
        middle = self.base_rpy.copy()
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if name in ROTATION_NAMES:
                middle[ROTATION_NAMES.index(name)] = (low + high) / 2.0
        roll, pitch, yaw = pose.rpy
        first = np.array([roll, pitch, yaw])
        # Every rotation has a second set of angles; the one nearer to the middle of the box is meant.
        second = np.array([roll + np.pi, np.pi - pitch, yaw + np.pi])
        candidates = [middle + (angles - middle + np.pi) % (2.0 * np.pi) - np.pi for angles in (first, second)]
        return min(candidates, key=lambda angles: float(np.abs(angles - middle).sum()))


def check_bounds(names: tuple[str, ...], lower: FloatArray, upper: FloatArray) -> None:
    """Check the bounds of a space.

    Raises:
        InvalidSettingsError: naming the dimension and the values.
    """
    if lower.shape != (len(names),) or upper.shape != (len(names),):
        raise InvalidSettingsError(
            f"this space has {len(names)} dimensions ({', '.join(names)}), got bounds of shapes "
            f"{lower.shape} and {upper.shape}"
        )
    for name, low, high in zip(names, lower, upper, strict=True):
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise InvalidSettingsError(f"bounds of '{name}' are {low} to {high}; they must be finite and rising")


def side_approach_rpy(hand: HandModel) -> FloatArray:
    """Return roll, pitch, yaw that turn the palm towards -y with the TCP's x axis (the fingers) along +x."""
    normal = hand.palm_normal
    return np.array([-np.pi / 2.0 if normal[2] < 0.0 else np.pi / 2.0, 0.0, 0.0])


def side_approach_bounds(target: TargetObject, hand: HandModel) -> tuple[FloatArray, FloatArray]:
    """Return bounds of x, y, z for the side approach, shapes (3,), metres.

    x (along the fingers): from the object's near edge under the middle of the fingers to its centre near the
    palm. y (approach axis): from a palm at the surface, where the object is slim, to fingers that no longer reach
    it. z: the object's height. On the thesis's bottle x and y are the thesis's own to within 5 mm; the thesis's
    z begins 10 mm lower and ends 26 mm lower than this one.
    """
    low, high = target.bounds
    middle = (low + high) / 2.0
    length, reach = finger_length(hand), finger_reach(hand)
    x_low = low[0] - 0.5 * length
    x_high = max(middle[0] - 0.25 * length, high[0] - 1.25 * length)
    return np.array([x_low, slim_depth(target), low[2]]), np.array([x_high, high[1] + reach, high[2]])


def slim_depth(target: TargetObject) -> float:
    """Return how far the surface reaches towards +y where the object is slim: the lower quartile over heights."""
    triangles = np.asarray(target.mesh.triangles)
    low, high = target.bounds[:, 2]
    depths = []
    for z in np.linspace(low, high, SLICES + 2)[1:-1]:
        crossing = (triangles[:, :, 2].min(axis=1) <= z) & (triangles[:, :, 2].max(axis=1) >= z)
        if crossing.any():
            depths.append(float(triangles[crossing, :, 1].max()))
    return float(np.quantile(depths, 0.25)) if depths else float(target.bounds[:, 1].mean())


def finger_length(hand: HandModel) -> float:
    """Return how far the stretched fingers reach ahead of the TCP along its x axis, metres."""
    transforms = hand.link_transforms()
    tips = []
    for shape in hand.urdf.collisions:
        centers, radii = covering_spheres(shape, transforms[shape.link] @ shape.T_link_shape)
        tips.append(float((centers[:, 0] + radii).max()))
    return max(*tips, 0.02)


def finger_reach(hand: HandModel) -> float:
    """Return how far the fingers get from the palm along its normal, metres: the longest chain, bent square.

    A chain is as long as the ways between its joints; a finger of one joint, as a gripper's, as its only link.
    """
    longest = 0.0
    for finger in hand.fingers:
        joints = [hand.urdf.joint(name) for name in finger.joints]
        length = sum(float(np.linalg.norm(joint.T_parent_joint[:3, 3])) for joint in joints[1:])
        if len(joints) == 1:
            length = link_length(hand, joints[0].child)
        longest = max(longest, length)
    return longest


def link_length(hand: HandModel, link: str) -> float:
    """Return how far a link's shapes reach from its joint, metres; 0 for a link without any."""
    longest = 0.0
    for shape in hand.urdf.collisions:
        if shape.link == link:
            centers, radii = covering_spheres(shape, shape.T_link_shape)
            longest = max(longest, float((np.linalg.norm(centers, axis=1) + radii).max()))
    return longest


def position_space(
    target: TargetObject,
    hand: HandModel,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
) -> PoseSpace:
    """Return the 3-D space of TCP positions at the fixed orientation of the side approach.

    Args:
        target: the object, from whose box the bounds are derived.
        hand: the hand.
        lower: lower bounds of x, y, z that override the derived ones, shape (3,), metres.
        upper: the same for the upper ones.

    Raises:
        InvalidSettingsError: bounds out of order.
    """
    derived = side_approach_bounds(target, hand)
    return _side_space(hand, POSITION_NAMES, ("m",) * 3, derived, (lower, upper))


def pose_space_6d(
    target: TargetObject,
    hand: HandModel,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
) -> PoseSpace:
    """Return the 6-D space of TCP poses around the side approach: x, y, z, roll, pitch, yaw.

    Args:
        target: the object, from whose box the bounds are derived.
        hand: the hand.
        lower: lower bounds that override the derived ones, shape (6,), metres and radians.
        upper: the same for the upper ones.

    Raises:
        InvalidSettingsError: bounds out of order.
    """
    low, high = side_approach_bounds(target, hand)
    rpy, span = side_approach_rpy(hand), np.array(DEFAULT_ROTATION_SPAN)
    derived = (np.concatenate([low, rpy - span]), np.concatenate([high, rpy + span]))
    names = (*POSITION_NAMES, *ROTATION_NAMES)
    return _side_space(hand, names, ("m",) * 3 + ("rad",) * 3, derived, (lower, upper))


def _side_space(
    hand: HandModel,
    names: tuple[str, ...],
    units: tuple[str, ...],
    derived: tuple[FloatArray, FloatArray],
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None],
) -> PoseSpace:
    """Return a space around the side approach; bounds that are given go before the derived ones."""
    lower, upper = (
        own if other is None else np.asarray(other, dtype=np.float64) for own, other in zip(derived, given, strict=True)
    )
    return PoseSpace(names, units, lower, upper, np.zeros(3), side_approach_rpy(hand))
