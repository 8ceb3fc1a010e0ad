"""Trials packed together, so that a million of them are read in a second.

A million rows are ten million Python objects, and making them takes longer than all else when an archive is
opened. So each run of ``CHUNK_TRIALS`` trials stands once more in the table ``chunk``, as two blocks of bytes.
The rows of ``trial`` stay the truth: triggers of the database remove the chunk of a row that is changed, added or
deleted, in the same transaction and whoever does it, and trials that no chunk covers are read row by row.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

CHUNK_TRIALS = 256
"""Trials of a chunk: writing one delays the trial that completes it by about a millisecond."""
READ_AT_ONCE = 4096
"""Rows of trials without a chunk that are in memory at a time."""
CAPSULE_BYTES = 14
CHECKSUM_BYTES = 4
BEFORE_ALL, LAST_STAMP = -1, 2**63 - 1

GRASP = np.dtype(
    [
        ("stamp", "<i8"),
        ("quality", "<f8"),
        ("position", "<f8", 3),
        ("quaternion", "<f8", 4),
        ("under_noise", "<f8", 3),
        ("capsules", "<i4"),
    ]
)
"""What the queries need of a grasp; a further number that they rank by becomes a field here, a column in
``_ROW_COLUMNS`` and a step of the schema that empties ``chunk``."""
_ROW_COLUMNS = "stamp_ns, quality, px, py, pz, qx, qy, qz, qw, expected_quality, quality_sd, worst_quality, hand_volume"


class Block(NamedTuple):
    """Some trials that follow each other by their stamps.

    Args:
        trials: how many, those without a quality above zero included.
        first_stamp: of these trials.
        last_stamp: of these trials.
        grasps: those with a quality above zero, of type ``GRASP``, shape (n,).
        volumes: their capsules as bytes, ``CAPSULE_BYTES`` each.
    """

    trials: int
    first_stamp: int
    last_stamp: int
    grasps: npt.NDArray[Any]
    volumes: bytes | memoryview


def read_blocks(connection: sqlite3.Connection, object_key: int, with_volumes: bool) -> Iterator[Block]:
    """Read all trials of an object in the order of their stamps.

    Args:
        connection: to the database.
        object_key: of the object.
        with_volumes: read the volumes of the hand as well; without them ``volumes`` of a chunk is empty.

    Raises:
        sqlite3.Error: the database is damaged.
        ValueError: a chunk is damaged.
    """
    chunks = connection.execute(
        f"SELECT trials, first_stamp_ns, last_stamp_ns, grasps, {'volumes' if with_volumes else 'NULL'} "
        "FROM chunk WHERE object = ? ORDER BY last_stamp_ns",
        (object_key,),
    )
    behind = BEFORE_ALL
    for chunk in chunks:
        block = _from_chunk(chunk)
        yield from _unpacked(connection, object_key, behind, block.first_stamp - 1, READ_AT_ONCE)
        yield block
        behind = block.last_stamp
    yield from _unpacked(connection, object_key, behind, LAST_STAMP, READ_AT_ONCE)


def count_packed(connection: sqlite3.Connection, object_key: int) -> int:
    """Return how many trials of an object stand in chunks."""
    query = "SELECT total(trials) FROM chunk WHERE object = ?"
    return int(connection.execute(query, (object_key,)).fetchone()[0])


def count_newest(connection: sqlite3.Connection, object_key: int) -> int:
    """Return how many trials of an object stand behind its last chunk."""
    query = "SELECT count(*) FROM trial WHERE object = ? AND stamp_ns > ?"
    return int(connection.execute(query, (object_key, _last_packed(connection, object_key))).fetchone()[0])


def pack_all(connection: sqlite3.Connection, object_key: int) -> None:
    """Write the chunks that are missing; to be called within a transaction."""
    bounds = connection.execute(
        "SELECT first_stamp_ns, last_stamp_ns FROM chunk WHERE object = ? ORDER BY last_stamp_ns",
        (object_key,),
    ).fetchall()
    for (_, behind), (first, _) in pairwise([(0, BEFORE_ALL), *bounds, (LAST_STAMP + 1, 0)]):
        _pack(connection, object_key, behind, first - 1)


def pack_newest(connection: sqlite3.Connection, object_key: int) -> None:
    """Write the chunks that are missing behind the last one; to be called within a transaction."""
    _pack(connection, object_key, _last_packed(connection, object_key), LAST_STAMP)


def _last_packed(connection: sqlite3.Connection, object_key: int) -> int:
    query = "SELECT max(last_stamp_ns) FROM chunk WHERE object = ?"
    (last,) = connection.execute(query, (object_key,)).fetchone()
    return BEFORE_ALL if last is None else int(last)


def _pack(connection: sqlite3.Connection, object_key: int, behind: int, up_to: int) -> None:
    for block in _unpacked(connection, object_key, behind, up_to, CHUNK_TRIALS):
        if block.trials == CHUNK_TRIALS:
            connection.execute(
                "INSERT INTO chunk (object, first_stamp_ns, last_stamp_ns, trials, grasps, volumes) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                (
                    object_key,
                    block.first_stamp,
                    block.last_stamp,
                    block.trials,
                    _sealed(block.grasps.tobytes()),
                    _sealed(block.volumes),
                ),
            )


def _unpacked(
    connection: sqlite3.Connection, object_key: int, behind: int, up_to: int, at_once: int
) -> Iterator[Block]:
    """Read the rows of trials with stamps above one and up to another."""
    cursor = connection.execute(
        f"SELECT {_ROW_COLUMNS} FROM trial WHERE object = ? AND stamp_ns > ? AND stamp_ns <= ? ORDER BY stamp_ns",
        (object_key, behind, up_to),
    )
    while rows := cursor.fetchmany(at_once):
        yield _from_rows(rows)


def _from_rows(rows: list[tuple[Any, ...]]) -> Block:
    graspable = [row for row in rows if row[1] is not None and row[1] > 0.0]
    volumes = [row[-1] or b"" for row in graspable]
    if any(len(volume) % CAPSULE_BYTES for volume in volumes):
        raise ValueError(f"a hand's volume is not a multiple of {CAPSULE_BYTES} bytes long")
    grasps = np.array(
        [
            # NULL becomes NaN.
            (row[0], row[1], row[2:5], row[5:9], row[9:12], len(volume) // CAPSULE_BYTES)
            for row, volume in zip(graspable, volumes, strict=True)
        ],
        dtype=GRASP,
    )
    return Block(len(rows), rows[0][0], rows[-1][0], grasps, b"".join(volumes))


def _from_chunk(chunk: tuple[Any, ...]) -> Block:
    trials, first, last, grasps, volumes = chunk
    return Block(
        int(trials),
        int(first),
        int(last),
        np.frombuffer(_unsealed(grasps, last), dtype=GRASP),
        b"" if volumes is None else _unsealed(volumes, last),
    )


def _sealed(content: bytes | memoryview) -> bytes:
    return zlib.crc32(content).to_bytes(CHECKSUM_BYTES, "little") + bytes(content)


def _unsealed(sealed: bytes, stamp_ns: int) -> memoryview:
    content = memoryview(sealed)[CHECKSUM_BYTES:]
    if zlib.crc32(content) != int.from_bytes(sealed[:CHECKSUM_BYTES], "little"):
        raise ValueError(f"the chunk of the trials up to {stamp_ns} ns has a wrong checksum")
    return content
