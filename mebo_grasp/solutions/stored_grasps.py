"""What the queries need of all stored grasps, read from the database in as few pieces as can be.

A million rows of ten columns are ten million Python objects, and making them takes longer than all else
when an archive is opened. So each trial carries its numbers once more as one block of bytes.
"""

from __future__ import annotations

import sqlite3
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from mebo_grasp.solutions.column import Column

FETCHED_ROWS = 20_000
CAPSULE_BYTES = 14
FIRST_CAPSULES = 32
"""Capsules a grasp for which there is room from the beginning; memory that is not written costs nothing."""

NUMBERS = struct.Struct("<q8d")
"""Stamp, quality, position and quaternion of a trial."""
_ROW = np.dtype([("stamp", "<i8"), ("quality", "<f8"), ("position", "<f8", 3), ("quaternion", "<f8", 4)])


def pack_numbers(*numbers: float | None) -> bytes | None:
    """Return stamp, quality, position and quaternion as bytes; None for a trial without a quality above 0."""
    quality = numbers[1]
    return NUMBERS.pack(*numbers) if quality is not None and quality > 0.0 else None


@dataclass(frozen=True)
class StoredGrasps:
    """What the queries need of all stored grasps with a quality above zero, in the order of their stamps.

    Args:
        trials: number of all trials stored when it was read, those without a quality above zero included.
        stamps_ns: shape (n,).
        qualities: shape (n,).
        positions: of the TCP in the object's frame, shape (n, 3), metres.
        quaternions: xyzw, shape (n, 4).
        first_capsule: capsules of grasp i are the rows ``first_capsule[i]`` to ``first_capsule[i + 1]``,
            shape (n + 1,).
        capsules: in the TCP's frame, as ``HandVolume.packed`` gives them, shape (c, 7).
        has_volumes: whether the hand's volume was asked for.
    """

    trials: int
    stamps_ns: Column
    qualities: Column
    positions: Column
    quaternions: Column
    first_capsule: Column
    capsules: Column
    has_volumes: bool

    @classmethod
    def load(cls, connection: sqlite3.Connection, object_key: int, with_volumes: bool) -> StoredGrasps:
        """Read the grasps of an object.

        Args:
            connection: to the database.
            object_key: of the object.
            with_volumes: read the volumes of the hand as well.

        Raises:
            sqlite3.Error: the database is damaged.
            ValueError: what is stored as numbers or as a volume has a wrong length.
        """
        key = (object_key,)
        (trials,) = connection.execute("SELECT count(*) FROM trial WHERE object = ?", key).fetchone()
        stored = cls._empty(int(trials), with_volumes)
        cursor = connection.execute(
            f"SELECT numbers, {'hand_volume' if with_volumes else 'NULL'} FROM trial "
            "WHERE object = ? AND numbers IS NOT NULL ORDER BY stamp_ns",
            key,
        )
        while rows := cursor.fetchmany(FETCHED_ROWS):
            stored._append(rows)
        return stored

    @classmethod
    def _empty(cls, trials: int, with_volumes: bool) -> StoredGrasps:
        first_capsule = Column.with_room(trials + 1, np.int64)
        first_capsule.extend(np.zeros(1, dtype=np.int64))
        return cls(
            trials=trials,
            stamps_ns=Column.with_room(trials, np.int64),
            qualities=Column.with_room(trials, np.float64),
            positions=Column.with_room(trials, np.float64, (3,)),
            quaternions=Column.with_room(trials, np.float64, (4,)),
            first_capsule=first_capsule,
            capsules=Column.with_room(FIRST_CAPSULES * trials if with_volumes else 0, np.int16, (7,)),
            has_volumes=with_volumes,
        )

    def _append(self, rows: list[tuple[Any, ...]]) -> None:
        """Add rows of numbers and volume behind those that are there."""
        numbers, volumes = zip(*rows, strict=True)
        table = np.frombuffer(b"".join(numbers), dtype=_ROW)
        if len(table) != len(rows):
            raise ValueError(f"{len(rows)} trials have the numbers of {len(table)}")
        self.stamps_ns.extend(table["stamp"])
        self.qualities.extend(table["quality"])
        self.positions.extend(table["position"])
        self.quaternions.extend(table["quaternion"])
        first = self.first_capsule.array[-1]
        if not self.has_volumes:
            self.first_capsule.extend(np.full(len(rows), first))
            return
        blobs = [blob or b"" for blob in volumes]
        lengths = np.fromiter(map(len, blobs), dtype=np.int64, count=len(blobs))
        self.first_capsule.extend(first + np.cumsum(lengths) // CAPSULE_BYTES)
        self.capsules.extend(np.frombuffer(b"".join(blobs), dtype="<i2").reshape(-1, 7))

    def without_volume(self) -> list[int]:
        """Return the stamps of the grasps whose hand volume is not stored."""
        missing = np.diff(self.first_capsule.array) == 0
        stamps: list[int] = self.stamps_ns.array[missing].tolist()
        return stamps
