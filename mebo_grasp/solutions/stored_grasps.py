"""What the queries need of all stored grasps, as columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mebo_grasp.solutions.column import Column
from mebo_grasp.solutions.trial_chunks import Block

FIRST_CAPSULES = 32
"""Capsules a grasp for which there is room from the beginning; memory that is not written costs nothing."""


@dataclass
class StoredGrasps:
    """What the queries need of all stored grasps with a quality above zero.

    Args:
        stamps_ns: shape (n,).
        qualities: shape (n,).
        positions: of the TCP in the object's frame, shape (n, 3), metres.
        quaternions: xyzw, shape (n, 4).
        under_noise: expected, sd and worst quality under noise, NaN when not known, shape (n, 3).
        first_capsule: capsules of grasp i are the rows ``first_capsule[i]`` to ``first_capsule[i + 1]``,
            shape (n + 1,).
        capsules: in the TCP's frame, as ``HandVolume.packed`` gives them, shape (c, 7).
        has_volumes: whether the hand's volume was asked for.
        trials: number of all trials that were read, those without a quality above zero included.
    """

    stamps_ns: Column
    qualities: Column
    positions: Column
    quaternions: Column
    under_noise: Column
    first_capsule: Column
    capsules: Column
    has_volumes: bool
    trials: int = 0

    @classmethod
    def gather(cls, blocks: Iterable[Block], expected: int, with_volumes: bool) -> StoredGrasps:
        """Read trials block by block.

        Args:
            blocks: in the order of their stamps.
            expected: about how many trials there are, so that the columns need not grow.
            with_volumes: keep the volumes of the hand as well.

        Raises:
            ValueError: the volumes of a block do not have the length that its grasps say.
        """
        stored = cls._empty(expected, with_volumes)
        for block in blocks:
            stored._append(block)
        return stored

    @classmethod
    def _empty(cls, expected: int, with_volumes: bool) -> StoredGrasps:
        first_capsule = Column.with_room(expected + 1, np.int64)
        first_capsule.extend(np.zeros(1, dtype=np.int64))
        return cls(
            stamps_ns=Column.with_room(expected, np.int64),
            qualities=Column.with_room(expected, np.float64),
            positions=Column.with_room(expected, np.float64, (3,)),
            quaternions=Column.with_room(expected, np.float64, (4,)),
            under_noise=Column.with_room(expected, np.float64, (3,)),
            first_capsule=first_capsule,
            capsules=Column.with_room(FIRST_CAPSULES * expected if with_volumes else 0, np.int16, (7,)),
            has_volumes=with_volumes,
        )

    def _append(self, block: Block) -> None:
        grasps = block.grasps
        self.trials += block.trials
        self.stamps_ns.extend(grasps["stamp"])
        self.qualities.extend(grasps["quality"])
        self.positions.extend(grasps["position"])
        self.quaternions.extend(grasps["quaternion"])
        self.under_noise.extend(grasps["under_noise"])
        counts = grasps["capsules"] if self.has_volumes else np.zeros(len(grasps), dtype=np.int64)
        self.first_capsule.extend(self.first_capsule.array[-1] + np.cumsum(counts))
        if self.has_volumes:
            self.capsules.extend(np.frombuffer(block.volumes, dtype="<i2").reshape(-1, 7))
            if len(self.capsules) != self.first_capsule.array[-1]:
                raise ValueError(f"the trials up to {block.last_stamp} ns lack capsules of the hand")

    def without_volume(self) -> list[int]:
        """Return the stamps of the grasps whose hand volume is not stored."""
        missing = np.diff(self.first_capsule.array) == 0
        stamps: list[int] = self.stamps_ns.array[missing].tolist()
        return stamps
