"""``pose_posture``: a TCP pose, and amplitudes of eigengrasps from which the hand closes (thesis, appendix A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import PoseSpace, checked_values, pose_space_6d, within
from mebo_grasp.grasping.synergies import SynergyBasis, hand_synergies
from mebo_grasp.grasping.target_object import TargetObject

FloatArray = npt.NDArray[np.float64]

DEFAULT_SYNERGIES = 2
AMPLITUDE_RANGE = (-1.0, 1.0)
"""Standard deviations about the mean posture; the thesis's own configuration has the same range."""


@dataclass(frozen=True, eq=False)
class PosturePoseSpace:
    """A box of candidates, each a pose and the posture in which the hand arrives there.

    Args:
        pose: the space of poses, whose dimensions come first.
        hand: the hand.
        basis: its synergies.
        synergy_lower, synergy_upper: bounds of the amplitudes, shape (b,), standard deviations.

    Raises:
        InvalidSettingsError: amplitudes that are out of order or more than the basis has.
    """

    pose: PoseSpace
    hand: HandModel
    basis: SynergyBasis
    synergy_lower: FloatArray
    synergy_upper: FloatArray

    def __post_init__(self) -> None:
        low, high = (np.array(v, dtype=np.float64) for v in (self.synergy_lower, self.synergy_upper))
        if low.shape != high.shape or low.ndim != 1 or not 0 < len(low) <= self.basis.count:
            raise InvalidSettingsError(
                f"{low.shape} and {high.shape} bounds of amplitudes; give 1 to {self.basis.count} of each"
            )
        if not (np.isfinite(low).all() and np.isfinite(high).all() and np.all(low < high)):
            raise InvalidSettingsError(f"bounds of amplitudes {low} to {high} must be finite and rising")
        object.__setattr__(self, "synergy_lower", low)
        object.__setattr__(self, "synergy_upper", high)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return (*self.pose.names, *(f"synergy_{i + 1}" for i in range(len(self.synergy_lower))))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each dimension."""
        return (*self.pose.units, *(("sd",) * len(self.synergy_lower)))

    @property
    def lower(self) -> FloatArray:
        """Lower bounds, shape (d,)."""
        return np.concatenate([self.pose.lower, self.synergy_lower])

    @property
    def upper(self) -> FloatArray:
        """Upper bounds, shape (d,)."""
        return np.concatenate([self.pose.upper, self.synergy_upper])

    @property
    def dimension(self) -> int:
        """Number of dimensions."""
        return self.pose.dimension + len(self.synergy_lower)

    def to_pose(self, x: npt.ArrayLike) -> Pose:
        """Return the pose of a candidate, shape (d,).

        Raises:
            InvalidSettingsError: wrong number of values.
        """
        return self.pose.to_pose(checked_values(x, self.names)[: self.pose.dimension])

    def to_posture(self, x: npt.ArrayLike) -> HandPosture:
        """Return the posture in which a candidate arrives, shape (d,).

        Raises:
            InvalidSettingsError: wrong number of values.
        """
        return self.basis.posture(self.hand, checked_values(x, self.names)[self.pose.dimension :])

    def from_pose(self, pose: Pose, posture: HandPosture) -> FloatArray:
        """Return the candidate nearest in meaning to a pose and a posture, shape (d,)."""
        amplitudes = self.basis.amplitudes(posture)[: len(self.synergy_lower)]
        return np.concatenate([self.pose.from_pose(pose), amplitudes])

    def contains(self, x: npt.ArrayLike, slack: float = 1e-9) -> bool:
        """Whether a candidate lies within the bounds."""
        return within(x, self.lower, self.upper, slack)


def pose_posture_space(
    target: TargetObject,
    hand: HandModel,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    synergies: int = DEFAULT_SYNERGIES,
) -> PosturePoseSpace:
    """Return the 6-D space of the side approach with amplitudes of the hand's first synergies.

    Args:
        target: the object, from whose box the bounds of the pose are derived.
        hand: the hand; its description names its synergies.
        lower: lower bounds that override the derived ones, shape (6 + synergies,).
        upper: the same for the upper ones.
        synergies: number of amplitudes.

    Raises:
        InvalidSettingsError: bounds out of order or of the wrong number.
        InvalidHandError: the hand has no synergies.
    """
    own = [np.full(synergies, value) for value in AMPLITUDE_RANGE]
    given: list[FloatArray | None] = []
    for index, bounds in enumerate((lower, upper)):
        values = None if bounds is None else np.asarray(bounds, dtype=np.float64)
        if values is not None:
            if values.shape != (6 + synergies,):
                raise InvalidSettingsError(f"give {6 + synergies} bounds (pose and amplitudes), got {values.shape}")
            own[index], values = values[6:], values[:6]
        given.append(values)
    return PosturePoseSpace(pose_space_6d(target, hand, given[0], given[1]), hand, hand_synergies(hand), own[0], own[1])
