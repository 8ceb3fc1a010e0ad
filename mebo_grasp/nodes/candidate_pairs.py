"""Poses and postures of candidates that come as two messages of one stamp. Knows no ROS and no clock.

Two topics keep no common order, and either message may be lost. Half a candidate waits for its other half for a
limited time; then it is given up, so that it can be answered. What comes for a candidate that was already given up
is late and dropped.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

PoseType = TypeVar("PoseType")
PostureType = TypeVar("PostureType")

NO_STAMP = 0
"""Of candidates typed by hand: what comes later under it is no late half but another candidate."""
MOST_WAITING = 100
"""Halves that wait at once; one more and the oldest is given up. As many as the topics keep."""
MOST_GIVEN_UP = 1000
"""Stamps remembered, so that their late halves are known as such."""


@dataclass(frozen=True)
class Half(Generic[PoseType, PostureType]):
    """A pose or a posture that waits for the other.

    Args:
        pose: the pose, None if that is missing.
        posture: the posture, None if that is missing.
        deadline: when it is given up, seconds.
    """

    pose: PoseType | None
    posture: PostureType | None
    deadline: float


class CandidatePairs(Generic[PoseType, PostureType]):
    """Puts poses and postures of one stamp together.

    Args:
        timeout: how long a half waits, seconds.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._waiting: dict[int, Half[PoseType, PostureType]] = {}
        self._given_up: deque[int] = deque(maxlen=MOST_GIVEN_UP)

    def add_pose(self, stamp_ns: int, pose: PoseType, now: float) -> tuple[PoseType, PostureType] | None:
        """Take a pose; return the pair if its posture is there."""
        half = self._waiting.get(stamp_ns)
        if half is not None and half.posture is not None:
            del self._waiting[stamp_ns]
            return pose, half.posture
        self._wait(stamp_ns, Half(pose, None, now + self._timeout))
        return None

    def add_posture(self, stamp_ns: int, posture: PostureType, now: float) -> tuple[PoseType, PostureType] | None:
        """Take a posture; return the pair if its pose is there."""
        half = self._waiting.get(stamp_ns)
        if half is not None and half.pose is not None:
            del self._waiting[stamp_ns]
            return half.pose, posture
        self._wait(stamp_ns, Half(None, posture, now + self._timeout))
        return None

    def give_up(self, now: float) -> dict[int, Half[PoseType, PostureType]]:
        """Return the halves that have waited too long or are too many, by their stamps, oldest first."""
        surplus = len(self._waiting) - MOST_WAITING
        lost = {
            stamp: half for i, (stamp, half) in enumerate(self._waiting.items()) if i < surplus or half.deadline <= now
        }
        for stamp in lost:
            del self._waiting[stamp]
            if stamp != NO_STAMP:
                self._given_up.append(stamp)
        return lost

    def _wait(self, stamp_ns: int, half: Half[PoseType, PostureType]) -> None:
        if stamp_ns not in self._given_up:
            self._waiting[stamp_ns] = half
