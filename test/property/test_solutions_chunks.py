"""Whatever is done to the rows of trials, reading them with the help of chunks gives the rows."""

import sqlite3
from collections.abc import Iterator
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mebo_grasp.solutions import trial_chunks
from mebo_grasp.solutions.schema import prepare_schema
from mebo_grasp.solutions.trial_chunks import LAST_STAMP, pack_all, pack_newest, read_blocks

CHUNK = 3
STAMPS = st.integers(0, 25) | st.sampled_from([LAST_STAMP - 1, LAST_STAMP])
QUALITIES = st.sampled_from([None, 0.0, -1.0, 0.25, 0.5, 1.0])
OPERATIONS = st.tuples(st.sampled_from(["add", "change", "move", "delete", "newest", "all"]), STAMPS, QUALITIES)

Row = tuple[int, float, bytes]


@pytest.fixture(scope="module")
def empty() -> Iterator[bytes]:
    connection = sqlite3.connect(":memory:", isolation_level=None)
    prepare_schema(connection, ":memory:")
    connection.execute("INSERT INTO object (id, name) VALUES (1, 'bottle'), (2, 'mug')")
    yield connection.serialize()
    connection.close()


def volume_of(stamp: int) -> bytes | None:
    return None if stamp % 4 == 0 else np.full((stamp % 4, 7), stamp % 100, "<i2").tobytes()


def perform(connection: sqlite3.Connection, name: str, stamp: int, quality: float | None) -> None:
    key = "object = 1 AND stamp_ns"
    if name == "add":
        connection.execute(
            "INSERT OR IGNORE INTO trial VALUES (1, ?, 1, 0, ?, 1, 2, 3, 0, 0, 0, 1, 0, 0, 0, 0, ?, 0.3, 0.1, 0.2, 5)",
            (stamp, quality, volume_of(stamp)),
        )
    elif name == "change":
        connection.execute(f"UPDATE trial SET quality = ? WHERE {key} = ?", (quality, stamp))
    elif name == "move":
        connection.execute(f"UPDATE OR IGNORE trial SET stamp_ns = 13 WHERE {key} = ?", (stamp,))
    elif name == "delete":
        connection.execute(f"DELETE FROM trial WHERE {key} = ?", (stamp,))
    else:
        (pack_newest if name == "newest" else pack_all)(connection, 1)


def read_with_chunks(connection: sqlite3.Connection) -> tuple[int, list[Row]]:
    trials, rows = 0, []
    for block in read_blocks(connection, 1, with_volumes=True):
        trials += block.trials
        ends = np.cumsum(block.grasps["capsules"]) * trial_chunks.CAPSULE_BYTES
        for grasp, begin, end in zip(block.grasps, [0, *ends], ends, strict=False):
            np.testing.assert_array_equal(grasp["position"], [1, 2, 3])
            np.testing.assert_array_equal(grasp["quaternion"], [0, 0, 0, 1])
            np.testing.assert_array_equal(grasp["under_noise"], [0.3, 0.1, 0.2])
            rows.append((int(grasp["stamp"]), float(grasp["quality"]), bytes(block.volumes[begin:end])))
    return trials, rows


@settings(deadline=None, max_examples=100)
@given(operations=st.lists(OPERATIONS, max_size=30))
def test_chunks_never_differ_from_the_rows(empty: bytes, operations: list[tuple[str, int, float]]) -> None:
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.deserialize(empty)
    begin = [("add", stamp, 0.25) for stamp in range(0, 24, 2)]
    with patch.object(trial_chunks, "CHUNK_TRIALS", CHUNK):
        for operation in [*begin, ("newest", 0, 0.0), *operations]:
            perform(connection, *operation)
        (trials,) = connection.execute("SELECT count(*) FROM trial").fetchone()
        rows = connection.execute(
            "SELECT stamp_ns, quality, coalesce(hand_volume, x'') FROM trial WHERE quality > 0 ORDER BY stamp_ns"
        ).fetchall()
        assert read_with_chunks(connection) == (trials, rows)
        pack_all(connection, 1)
        assert read_with_chunks(connection) == (trials, rows)
        (packed,) = connection.execute("SELECT coalesce(sum(trials), 0) FROM chunk").fetchone()
        assert packed == count_in_full_runs(connection)
    connection.close()


def count_in_full_runs(connection: sqlite3.Connection) -> int:
    """How many trials stand in chunks when every gap between chunks holds fewer than a chunk."""
    bounds = connection.execute("SELECT first_stamp_ns, last_stamp_ns FROM chunk ORDER BY 1").fetchall()
    stamps = [stamp for (stamp,) in connection.execute("SELECT stamp_ns FROM trial ORDER BY 1")]
    inside = [any(first <= stamp <= last for first, last in bounds) for stamp in stamps]
    gap = 0
    for is_inside in inside:
        gap = 0 if is_inside else gap + 1
        assert gap < CHUNK
    return sum(inside)
