"""Trials in SQLite: what is on the disk, and when it is written.

``trial`` holds what queries need, one row a trial; ``trial_detail`` holds what only a returned grasp needs;
``chunk`` holds runs of trials once more for a quick start. All of a trial is written in one transaction.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mebo_grasp.errors import ArchiveError
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.database_errors import as_archive_errors, require_database, require_place
from mebo_grasp.solutions.hand_volume import PackedVolume
from mebo_grasp.solutions.schema import prepare_schema
from mebo_grasp.solutions.stored_grasps import StoredGrasps
from mebo_grasp.solutions.trial_chunks import (
    CHUNK_TRIALS,
    LAST_STAMP,
    count_newest,
    count_packed,
    pack_all,
    pack_newest,
    read_blocks,
)
from mebo_grasp.solutions.trial_rows import (
    DETAIL_COLUMNS,
    SELECT_WHOLE,
    TRIAL_COLUMNS,
    detail_values,
    to_stamped_grasp,
    trial_values,
)
from mebo_grasp.solutions.writer_lock import WriterLock

IN_MEMORY = ":memory:"
NOT_STORED = -1
"""Key of an object or session that no row names yet."""


@dataclass(frozen=True)
class Session:
    """One opening of an archive in which trials were stored.

    Args:
        id: number, in the order of time.
        begun_ns: time of its first trial, nanoseconds since the epoch.
        trials: how many of the object it stored.
    """

    id: int
    begun_ns: int
    trials: int


class TrialStore:
    """The trials of one object in a database that may hold several objects.

    Args:
        path: database file, created when absent, or ``":memory:"``.
        object_id: name of the object whose trials are read and written.
        sync_each_trial: wait for the disk at each trial, so that a loss of power loses none either.

    Raises:
        ArchiveError: the database cannot be opened, is damaged, foreign, of a newer version or in use.
    """

    def __init__(self, path: str | Path, object_id: str, sync_each_trial: bool = False) -> None:
        self.path = str(path)
        self.object_id = object_id
        self._lock: WriterLock | None = None
        if self.path != IN_MEMORY:
            require_place(Path(self.path))
            self._lock = WriterLock(Path(self.path))
        try:
            if self._lock is not None:
                require_database(Path(self.path))
            self._connection = self._open(sync_each_trial)
        except BaseException:
            if self._lock is not None:
                self._lock.release()
            raise

    def _open(self, sync_each_trial: bool) -> sqlite3.Connection:
        with as_archive_errors(self.path, "open"):
            connection = sqlite3.connect(self.path, timeout=0.0, isolation_level=None, check_same_thread=False)
            try:
                prepare_schema(connection, self.path)
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute(f"PRAGMA synchronous = {'FULL' if sync_each_trial else 'NORMAL'}")
                self._object_key = self._find_object(connection)
                self._session, self._unpacked = NOT_STORED, 0
            except BaseException:
                connection.close()
                raise
        return connection

    def _find_object(self, connection: sqlite3.Connection) -> int:
        row = connection.execute("SELECT id FROM object WHERE name = ?", (self.object_id,)).fetchone()
        return NOT_STORED if row is None else int(row[0])

    def _begin_session(self, connection: sqlite3.Connection) -> None:
        """Name the object and this session, at the first trial: opening alone changes nothing."""
        connection.execute("INSERT OR IGNORE INTO object (name) VALUES (?)", (self.object_id,))
        cursor = connection.execute("INSERT INTO session (begun_ns) VALUES (?)", (time.time_ns(),))
        self._object_key = self._find_object(connection)
        self._session = int(cursor.lastrowid or 0)
        self._unpacked = count_newest(connection, self._object_key)

    @contextmanager
    def _transaction(self, doing: str) -> Iterator[sqlite3.Connection]:
        with as_archive_errors(self.path, doing):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                # SQLite has rolled back by itself after some errors, a full disk among them.
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def insert(self, stamped: StampedGrasp, volume: PackedVolume | None = None) -> bool:
        """Write a trial and commit it; return False when its stamp is stored already.

        Args:
            stamped: the trial.
            volume: capsules of the hand, if known.

        Raises:
            ArchiveError: the trial cannot be written; nothing of it is stored then.
        """
        return self.insert_many([(stamped, volume)]) == 1

    def insert_many(self, trials: list[tuple[StampedGrasp, PackedVolume | None]]) -> int:
        """Write trials in one transaction; return how many were new.

        Args:
            trials: each with the capsules of the hand, if known.

        Raises:
            ArchiveError: a trial cannot be written; none of them is stored then.
        """
        for stamped, _ in trials:
            if not 0 <= stamped.stamp_ns <= LAST_STAMP:
                raise ArchiveError(f"stamp {stamped.stamp_ns} ns is outside 0 to {LAST_STAMP}, it cannot be stored")
        before = self._session, self._object_key, self._unpacked
        try:
            with self._transaction("write to") as connection:
                if self._session == NOT_STORED:
                    self._begin_session(connection)
                added = sum(self._insert(connection, *trial) for trial in trials)
                self._unpacked += added
                if self._unpacked >= CHUNK_TRIALS:
                    pack_newest(connection, self._object_key)
                    self._unpacked %= CHUNK_TRIALS
                return added
        except BaseException:
            self._session, self._object_key, self._unpacked = before
            raise

    def pack(self) -> None:
        """Pack what came in another order than that of the stamps, or was changed, for a quick start.

        Raises:
            ArchiveError: the database cannot be written; the trials stay as they are.
        """
        with self._transaction("write to") as connection:
            pack_all(connection, self._object_key)

    def _insert(self, connection: sqlite3.Connection, stamped: StampedGrasp, volume: PackedVolume | None) -> bool:
        cursor = connection.execute(
            f"INSERT OR IGNORE INTO trial (object, session, hand_volume, {TRIAL_COLUMNS}) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                self._object_key,
                self._session,
                None if volume is None else _to_bytes(volume),
                *trial_values(stamped),
            ),
        )
        if cursor.rowcount == 0:
            return False
        connection.execute(
            f"INSERT INTO trial_detail (object, stamp_ns, {DETAIL_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (self._object_key, stamped.stamp_ns, *detail_values(stamped.grasp)),
        )
        return True

    def load(self, with_volumes: bool) -> StoredGrasps:
        """Read what the queries need of every grasp with a quality above zero, ordered by stamp.

        Args:
            with_volumes: read the volumes of the hand as well.

        Raises:
            ArchiveError: the database is damaged.
        """
        with as_archive_errors(self.path, "read"):
            try:
                expected = count_packed(self._connection, self._object_key)
                blocks = read_blocks(self._connection, self._object_key, with_volumes)
                return StoredGrasps.gather(blocks, expected, with_volumes)
            except (ValueError, TypeError) as error:
                raise ArchiveError(
                    f"cannot read the archive {self.path}: {error}; the file is damaged: restore a copy or "
                    "name another file"
                ) from error

    def store_volumes(self, volumes: Iterable[tuple[int, PackedVolume]]) -> None:
        """Add the hand's volume to trials that are stored, all in one transaction.

        Args:
            volumes: stamps and capsules.

        Raises:
            ArchiveError: they cannot be written; none of them is stored then.
        """
        with self._transaction("write to") as connection:
            connection.executemany(
                "UPDATE trial SET hand_volume = ? WHERE object = ? AND stamp_ns = ?",
                ((_to_bytes(capsules), self._object_key, stamp) for stamp, capsules in volumes),
            )

    def read(self, stamp_ns: int) -> StampedGrasp:
        """Read one trial whole.

        Raises:
            ArchiveError: it is not stored or is damaged.
        """
        with as_archive_errors(self.path, "read"):
            row = self._connection.execute(
                f"{SELECT_WHOLE} AND trial.stamp_ns = ?", (self._object_key, stamp_ns)
            ).fetchone()
        if row is None:
            raise ArchiveError(f"no trial with stamp {stamp_ns} ns of '{self.object_id}' is stored")
        return self._from_row(row)

    def read_after(self, stamp_ns: int, limit: int) -> list[StampedGrasp]:
        """Read the first trials after a stamp whole, in the order of their stamps.

        Raises:
            ArchiveError: the database is damaged.
        """
        with as_archive_errors(self.path, "read"):
            rows = self._connection.execute(
                f"{SELECT_WHOLE} AND trial.stamp_ns > ? ORDER BY trial.stamp_ns LIMIT ?",
                (self._object_key, stamp_ns, limit),
            ).fetchall()
        return [self._from_row(row) for row in rows]

    def sessions(self) -> tuple[Session, ...]:
        """Return the sessions in which trials of the object were stored."""
        with as_archive_errors(self.path, "read"):
            rows = self._connection.execute(
                "SELECT session.id, begun_ns, count(*) FROM session "
                "JOIN trial ON trial.session = session.id WHERE object = ? "
                "GROUP BY session.id ORDER BY session.id",
                (self._object_key,),
            ).fetchall()
        return tuple(Session(*row) for row in rows)

    def _from_row(self, row: tuple[Any, ...]) -> StampedGrasp:
        try:
            return to_stamped_grasp(row, self.object_id)
        except (ValueError, TypeError) as error:
            raise ArchiveError(f"trial {row[0]} ns of '{self.object_id}' in {self.path} is damaged: {error}") from error

    def delete_object(self) -> int:
        """Delete all trials of the object; return how many there were."""
        with self._transaction("write to") as connection:
            # The chunks first, so that the trigger of each trial finds none.
            connection.execute("DELETE FROM chunk WHERE object = ?", (self._object_key,))
            connection.execute("DELETE FROM trial_detail WHERE object = ?", (self._object_key,))
            cursor = connection.execute("DELETE FROM trial WHERE object = ?", (self._object_key,))
            return cursor.rowcount

    def object_counts(self) -> dict[str, int]:
        """Return the number of trials of each object in the database."""
        with as_archive_errors(self.path, "read"):
            rows = self._connection.execute(
                "SELECT name, count(trial.stamp_ns) FROM object "
                "LEFT JOIN trial ON trial.object = object.id GROUP BY name ORDER BY name"
            ).fetchall()
        return {str(name): int(count) for name, count in rows}

    def close(self) -> None:
        """Close the database; harmless when called again."""
        self._connection.close()
        if self._lock is not None:
            self._lock.release()


def _to_bytes(volume: PackedVolume) -> bytes:
    return volume.astype("<i2").tobytes()
