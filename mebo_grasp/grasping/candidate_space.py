"""The search spaces by name: what ``optimizer_node`` and ``explore`` let choose from."""

from __future__ import annotations

import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.facet_space import FacetSpace, facet_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import PoseSpace, pose_space_6d, position_space
from mebo_grasp.grasping.posture_space import DEFAULT_SYNERGIES, PosturePoseSpace, pose_posture_space
from mebo_grasp.grasping.target_object import TargetObject

CandidateSpace = PoseSpace | FacetSpace | PosturePoseSpace
SPACES = ("position", "pose", "pose_posture", "facet")


def candidate_space(
    name: str,
    target: TargetObject,
    hand: HandModel,
    lower: npt.ArrayLike | None = None,
    upper: npt.ArrayLike | None = None,
    facet: str = "+y",
    synergies: int = DEFAULT_SYNERGIES,
) -> CandidateSpace:
    """Make the space of a name.

    Args:
        name: one of ``SPACES``.
        target: the object, from whose box the bounds are derived.
        hand: the hand.
        lower: lower bounds that override the derived ones, shape (d,), metres and radians.
        upper: the same for the upper ones.
        facet: what the hand faces, in space "facet".
        synergies: number of amplitudes, in space "pose_posture".

    Raises:
        InvalidSettingsError: unknown name or facet, or bounds out of order.
        InvalidHandError: a posture is asked of a hand that has no synergies.
    """
    if name == "position":
        return position_space(target, hand, lower, upper)
    if name == "pose":
        return pose_space_6d(target, hand, lower, upper)
    if name == "pose_posture":
        return pose_posture_space(target, hand, lower, upper, synergies=synergies)
    if name == "facet":
        return facet_space(target, hand, lower, upper, facet=facet)
    raise InvalidSettingsError(f"space is '{name}', known are {', '.join(SPACES)}")
