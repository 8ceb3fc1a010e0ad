"""All stored grasps of an object in memory, so that no question has to wait for the disk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.diversity import IntArray, PoseMetric
from mebo_grasp.solutions.occlusion import NOT_BLOCKED, first_blocking
from mebo_grasp.solutions.trial_store import StoredPoses

FIRST_BLOCK = 256
"""Grasps looked at in the first step of a search; each further step looks at twice as many."""


@dataclass(frozen=True)
class Found:
    """What a search found: stamps best first, and what it looked at on the way.

    Args:
        stamps_ns: of the grasps found, best first.
        considered: grasps of enough quality that were looked at.
        blocked: shape (number of occlusions,), how many of them each occlusion blocked.
    """

    stamps_ns: tuple[int, ...]
    considered: int
    blocked: IntArray


class GraspIndex:
    """Grasps with a quality above zero, sorted by quality, then by stamp.

    Args:
        poses: what is stored already.
    """

    def __init__(self, poses: StoredPoses) -> None:
        self._stamps = poses.stamps_ns
        self._qualities = poses.qualities
        self._positions = poses.positions
        self._quaternions = poses.quaternions
        # Rows come in the order of their stamps, so a stable sort breaks ties by stamp.
        self._order = np.argsort(-self._qualities, kind="stable")

    def __len__(self) -> int:
        return len(self._qualities)

    @property
    def best_quality(self) -> float:
        """The best quality, 0 when nothing is stored."""
        return float(self._qualities[self._order[0]]) if len(self) else 0.0

    def add(self, stamp_ns: int, quality: float, pose: Pose) -> None:
        """Add one grasp; its quality must be above zero and its stamp new."""
        ties = self._qualities[self._order]
        first = int(np.searchsorted(-ties, -quality, side="left"))
        last = int(np.searchsorted(-ties, -quality, side="right"))
        rank = first + int(np.searchsorted(self._stamps[self._order[first:last]], stamp_ns))
        self._order = np.insert(self._order, rank, len(self))
        self._stamps = np.append(self._stamps, stamp_ns)
        self._qualities = np.append(self._qualities, quality)
        self._positions = np.concatenate([self._positions, pose.position[None]])
        self._quaternions = np.concatenate([self._quaternions, pose.quaternion_xyzw[None]])

    def search(self, query: BestGraspQuery, metric: PoseMetric) -> Found:
        """Find the best grasps that are free of occlusions and, if asked, mutually diverse."""
        sorted_qualities = self._qualities[self._order]
        eligible = int(np.searchsorted(-sorted_qualities, -query.min_quality, side="right"))
        blocked = np.zeros(len(query.occlusions), dtype=np.int64)
        taken: list[int] = []
        begin, step = 0, FIRST_BLOCK
        while begin < eligible:
            rows = self._order[begin : min(begin + step, eligible)]
            blocking = first_blocking(query.occlusions, self._positions[rows])
            last = self._take(rows, blocking == NOT_BLOCKED, taken, query, metric)
            seen = blocking[:last]
            np.add.at(blocked, seen[seen != NOT_BLOCKED], 1)
            begin += last
            if len(taken) == query.max_grasps:
                break
            step *= 2
        return Found(tuple(int(self._stamps[row]) for row in taken), begin, blocked)

    def _take(
        self,
        rows: IntArray,
        is_free: np.ndarray,
        taken: list[int],
        query: BestGraspQuery,
        metric: PoseMetric,
    ) -> int:
        """Extend ``taken`` from sorted rows; return how many rows were looked at."""
        is_open = is_free.copy()
        if query.min_diversity > 0.0:
            for row in taken:
                is_open &= self._is_diverse(row, rows, query.min_diversity, metric)
        offset = 0
        while len(taken) < query.max_grasps:
            candidates = np.flatnonzero(is_open[offset:])
            if not len(candidates):
                return len(rows)
            offset += int(candidates[0]) + 1
            taken.append(int(rows[offset - 1]))
            if query.min_diversity > 0.0:
                is_open &= self._is_diverse(taken[-1], rows, query.min_diversity, metric)
        return offset

    def _is_diverse(
        self, row: int, rows: IntArray, min_diversity: float, metric: PoseMetric
    ) -> np.ndarray:
        pose = Pose(self._positions[row], self._quaternions[row])
        distances: FloatArray = metric.to_many(
            pose, self._positions[rows], self._quaternions[rows]
        )
        return distances >= min_diversity
