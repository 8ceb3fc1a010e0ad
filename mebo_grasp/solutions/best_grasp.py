"""The question "what is the best grasp now?" and its answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.occlusion import Occlusion


@dataclass(frozen=True)
class BestGraspQuery:
    """Which grasps are wanted. Only grasps with a quality above zero are ever considered.

    Args:
        occlusions: regions in which no grasp may be used.
        max_grasps: how many grasps at most.
        min_quality: least quality of a grasp.
        min_diversity: least mutual distance of the returned grasps, metres; 0 for none.
        rule: when a grasp counts as blocked.
        approach_length: under the rule ``HAND``, length of the straight path by which the TCP arrives,
            against the approach axis, metres; 0 for none.

    Raises:
        InvalidQueryError: a number is out of range or not finite.
    """

    occlusions: tuple[Occlusion, ...] = ()
    max_grasps: int = 1
    min_quality: float = 0.0
    min_diversity: float = 0.0
    rule: BlockingRule = BlockingRule.TCP
    approach_length: float = 0.0

    def __post_init__(self) -> None:
        if self.max_grasps < 1:
            raise InvalidQueryError(f"max_grasps must be at least 1, got {self.max_grasps}")
        for name in ("min_quality", "min_diversity", "approach_length"):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0.0:
                raise InvalidQueryError(f"{name} must be finite and at least 0, got {value}")
            object.__setattr__(self, name, float(value))
        object.__setattr__(self, "occlusions", tuple(self.occlusions))


@dataclass(frozen=True)
class BestGraspAnswer:
    """The best grasps that are not blocked.

    Grasps of enough quality are looked at from the best downwards until enough are found; equal
    qualities in the order of their stamps.

    Args:
        grasps: best first, mutually diverse if the query asked for it.
        considered: grasps of enough quality that were looked at: all those at least as good as the last
            one returned, or all of them when fewer than ``max_grasps`` were found.
        occluded: of these, blocked.
        blocked_by: names of the occlusions that blocked them, with counts; each blocked grasp counts
            once, for one of the occlusions that block it.
    """

    grasps: tuple[StampedGrasp, ...]
    considered: int
    occluded: int
    blocked_by: tuple[tuple[str, int], ...] = ()

    @property
    def explanation(self) -> str:
        """Why nothing is left; empty when grasps were found."""
        if self.grasps:
            return ""
        if self.considered == 0:
            return "no grasp of enough quality is stored"
        blockers = ", ".join(f"'{name}' ({count})" for name, count in self.blocked_by)
        return f"all {self.considered} grasps of enough quality are blocked, by {blockers}"
