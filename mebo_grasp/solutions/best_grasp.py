"""The question "what is the best grasp now?" and its answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.occlusion import Occlusion
from mebo_grasp.solutions.ranking import DEFAULT_QUANTILE, Ranking


@dataclass(frozen=True)
class BestGraspQuery:
    """Which grasps are wanted. Only grasps with a quality above zero are ever considered.

    Args:
        occlusions: regions in which no grasp may be used.
        max_grasps: how many grasps at most.
        min_quality: least quality of a grasp, or of the figure that ranks.
        min_diversity: least mutual distance of the returned grasps, metres; 0 for none.
        rule: when a grasp counts as blocked.
        approach_length: under the rule ``HAND``, length of the straight path by which the TCP arrives,
            against the approach axis, metres; 0 for none.
        ranking: figure by which the best is told, and that ``min_quality`` limits; it must be above zero too.
        quantile: for the ranking ``QUANTILE``, share of executions that may be worse, above 0 and at most 0.5.

    Raises:
        InvalidQueryError: a number is out of range or not finite.
    """

    occlusions: tuple[Occlusion, ...] = ()
    max_grasps: int = 1
    min_quality: float = 0.0
    min_diversity: float = 0.0
    rule: BlockingRule = BlockingRule.TCP
    approach_length: float = 0.0
    ranking: Ranking = Ranking.OBSERVED
    quantile: float = DEFAULT_QUANTILE

    def __post_init__(self) -> None:
        if self.max_grasps < 1:
            raise InvalidQueryError(f"max_grasps must be at least 1, got {self.max_grasps}")
        for name in ("min_quality", "min_diversity", "approach_length"):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0.0:
                raise InvalidQueryError(f"{name} must be finite and at least 0, got {value}")
            object.__setattr__(self, name, float(value))
        if not 0.0 < self.quantile <= 0.5:
            raise InvalidQueryError(
                f"quantile must be above 0 and at most 0.5, got {self.quantile}; it is the share of "
                "executions that may be worse"
            )
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
        ranking: figure by which the best was told.
        passed_over: grasps that were not considered, as that figure is not known of them.
    """

    grasps: tuple[StampedGrasp, ...]
    considered: int
    occluded: int
    blocked_by: tuple[tuple[str, int], ...] = ()
    ranking: Ranking = Ranking.OBSERVED
    passed_over: int = 0

    @property
    def remark(self) -> str:
        """How many grasps were passed over; empty when none was."""
        if not self.passed_over:
            return ""
        return f"{self.passed_over} grasps were passed over, as their {self.ranking} quality is not known"

    @property
    def explanation(self) -> str:
        """Why nothing is left; empty when grasps were found."""
        if self.grasps:
            return ""
        figure = "quality" if self.ranking is Ranking.OBSERVED else f"{self.ranking} quality"
        if self.considered == 0:
            reason = f"no grasp of enough {figure} is stored"
        else:
            blockers = ", ".join(f"'{name}' ({count})" for name, count in self.blocked_by)
            reason = f"all {self.considered} grasps of enough {figure} are blocked, by {blockers}"
        return f"{reason}; {self.remark}" if self.remark else reason
