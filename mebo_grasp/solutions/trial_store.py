"""Trials in SQLite: what is on the disk, and in which shape.

``trial`` holds what queries need, one row a trial, ordered by object and stamp, so that a start reads it
in one sweep; ``trial_detail`` holds what only a returned grasp needs. Both rows of a trial are written
in one transaction. NaN is stored as NULL, which is how SQLite keeps it.
"""

from __future__ import annotations

import json
import math
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.errors import ArchiveError
from mebo_grasp.grasp import (
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    Pose,
    StampedGrasp,
)
from mebo_grasp.solutions.hand_volume import PackedVolume
from mebo_grasp.solutions.schema import prepare_schema
from mebo_grasp.solutions.stored_grasps import StoredGrasps, pack_numbers
from mebo_grasp.solutions.writer_lock import WriterLock

SQLITE_MAGIC = b"SQLite format 3\x00"
IN_MEMORY = ":memory:"
LARGEST_STAMP_NS = 2**63 - 1
NOT_STORED = -1
"""Key of an object or session that no row names yet."""

_TRIAL_COLUMNS = (
    "stamp_ns, outcome, quality, px, py, pz, qx, qy, qz, qw, epsilon, volume, isotropy, force_closure"
)
_DETAIL_COLUMNS = (
    "hand, computation_time, message, joint_names, joint_positions, contact_links, contact_vectors"
)


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


@contextmanager
def _as_archive_errors(path: str, doing: str) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise ArchiveError(f"cannot {doing} the archive {path}: {_explain(error)}") from error


def _explain(error: sqlite3.Error) -> str:
    text = str(error)
    if "readonly" in text or "unable to open" in text:
        return f"{text}; check the permissions of the file and of its folder"
    if "full" in text or "disk I/O error" in text:
        return f"{text}; free space on the disk, what is stored is untouched"
    if "malformed" in text or "not a database" in text:
        return f"{text}; the file is damaged: restore a copy or name another file"
    if "locked" in text:
        return f"{text}; another program writes to it"
    return text


def _require_database(path: Path) -> None:
    """Refuse what is not SQLite before SQLite gets a chance to touch it."""
    if not path.parent.is_dir():
        raise ArchiveError(f"the folder of the archive {path} does not exist; make it first")
    if path.is_dir():
        raise ArchiveError(f"the archive {path} is a folder; name a file")
    if not path.exists():
        return
    try:
        with path.open("rb") as file:
            start = file.read(len(SQLITE_MAGIC))
        with path.open("r+b"):
            pass
    except OSError as error:
        raise ArchiveError(
            f"the archive {path} cannot be opened for writing: {error.strerror}"
        ) from error
    if start and start != SQLITE_MAGIC:
        raise ArchiveError(f"{path} is not an SQLite database; it is left as it is, name another file")


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
            _require_database(Path(self.path))
            self._lock = WriterLock(Path(self.path))
        try:
            self._connection = self._open(sync_each_trial)
        except BaseException:
            if self._lock is not None:
                self._lock.release()
            raise

    def _open(self, sync_each_trial: bool) -> sqlite3.Connection:
        with _as_archive_errors(self.path, "open"):
            connection = sqlite3.connect(
                self.path, timeout=0.0, isolation_level=None, check_same_thread=False
            )
            try:
                prepare_schema(connection, self.path)
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute(f"PRAGMA synchronous = {'FULL' if sync_each_trial else 'NORMAL'}")
                self._object_key = self._find_object(connection)
                self._session = NOT_STORED
            except BaseException:
                connection.close()
                raise
        return connection

    def _find_object(self, connection: sqlite3.Connection) -> int:
        row = connection.execute(
            "SELECT id FROM object WHERE name = ?", (self.object_id,)
        ).fetchone()
        return NOT_STORED if row is None else int(row[0])

    def _begin_session(self, connection: sqlite3.Connection) -> None:
        """Name the object and this session, at the first trial: opening alone changes nothing."""
        connection.execute("INSERT OR IGNORE INTO object (name) VALUES (?)", (self.object_id,))
        cursor = connection.execute("INSERT INTO session (begun_ns) VALUES (?)", (time.time_ns(),))
        self._object_key = self._find_object(connection)
        self._session = int(cursor.lastrowid or 0)

    @contextmanager
    def _transaction(self, doing: str) -> Iterator[sqlite3.Connection]:
        with _as_archive_errors(self.path, doing):
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
            if not 0 <= stamped.stamp_ns <= LARGEST_STAMP_NS:
                raise ArchiveError(
                    f"stamp {stamped.stamp_ns} ns is outside 0 to {LARGEST_STAMP_NS}, it cannot be stored"
                )
        session, object_key = self._session, self._object_key
        try:
            with self._transaction("write to") as connection:
                if session == NOT_STORED:
                    self._begin_session(connection)
                return sum(self._insert(connection, *trial) for trial in trials)
        except BaseException:
            self._session, self._object_key = session, object_key
            raise

    def _insert(
        self, connection: sqlite3.Connection, stamped: StampedGrasp, volume: PackedVolume | None
    ) -> bool:
        cursor = connection.execute(
            f"INSERT OR IGNORE INTO trial (object, session, hand_volume, numbers, {_TRIAL_COLUMNS}) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                self._object_key,
                self._session,
                None if volume is None else _to_bytes(volume),
                _packed_numbers(stamped),
                *_trial_values(stamped),
            ),
        )
        if cursor.rowcount == 0:
            return False
        connection.execute(
            f"INSERT INTO trial_detail (object, stamp_ns, {_DETAIL_COLUMNS}) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (self._object_key, stamped.stamp_ns, *_detail_values(stamped.grasp)),
        )
        return True

    def load(self, with_volumes: bool) -> StoredGrasps:
        """Read what the queries need of every grasp with a quality above zero, ordered by stamp.

        Args:
            with_volumes: read the volumes of the hand as well.

        Raises:
            ArchiveError: the database is damaged.
        """
        with _as_archive_errors(self.path, "read"):
            try:
                return StoredGrasps.load(self._connection, self._object_key, with_volumes)
            except ValueError as error:
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
        with _as_archive_errors(self.path, "read"):
            row = self._connection.execute(
                f"{_SELECT_WHOLE} AND trial.stamp_ns = ?", (self._object_key, stamp_ns)
            ).fetchone()
        if row is None:
            raise ArchiveError(f"no trial with stamp {stamp_ns} ns of '{self.object_id}' is stored")
        return self._from_row(row)

    def read_after(self, stamp_ns: int, limit: int) -> list[StampedGrasp]:
        """Read the first trials after a stamp whole, in the order of their stamps.

        Raises:
            ArchiveError: the database is damaged.
        """
        with _as_archive_errors(self.path, "read"):
            rows = self._connection.execute(
                f"{_SELECT_WHOLE} AND trial.stamp_ns > ? ORDER BY trial.stamp_ns LIMIT ?",
                (self._object_key, stamp_ns, limit),
            ).fetchall()
        return [self._from_row(row) for row in rows]

    def sessions(self) -> tuple[Session, ...]:
        """Return the sessions in which trials of the object were stored."""
        with _as_archive_errors(self.path, "read"):
            rows = self._connection.execute(
                "SELECT session.id, begun_ns, count(*) FROM session "
                "JOIN trial ON trial.session = session.id WHERE object = ? "
                "GROUP BY session.id ORDER BY session.id",
                (self._object_key,),
            ).fetchall()
        return tuple(Session(*row) for row in rows)

    def _from_row(self, row: tuple[Any, ...]) -> StampedGrasp:
        try:
            return _to_stamped_grasp(row, self.object_id)
        except (ValueError, TypeError) as error:
            raise ArchiveError(
                f"trial {row[0]} ns of '{self.object_id}' in {self.path} is damaged: {error}"
            ) from error

    def delete_object(self) -> int:
        """Delete all trials of the object; return how many there were."""
        with self._transaction("write to") as connection:
            connection.execute("DELETE FROM trial_detail WHERE object = ?", (self._object_key,))
            cursor = connection.execute("DELETE FROM trial WHERE object = ?", (self._object_key,))
            return cursor.rowcount

    def object_counts(self) -> dict[str, int]:
        """Return the number of trials of each object in the database."""
        with _as_archive_errors(self.path, "read"):
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


_SELECT_WHOLE = (
    f"SELECT trial.{_TRIAL_COLUMNS.replace(', ', ', trial.')}, {_DETAIL_COLUMNS} FROM trial "
    "JOIN trial_detail ON trial_detail.object = trial.object "
    "AND trial_detail.stamp_ns = trial.stamp_ns WHERE trial.object = ?"
)


def _trial_values(stamped: StampedGrasp) -> tuple[float | int, ...]:
    grasp = stamped.grasp
    pose = grasp.T_object_tcp
    return (
        stamped.stamp_ns, int(grasp.outcome), grasp.quality, *map(float, pose.position),
        *map(float, pose.quaternion_xyzw), grasp.epsilon, grasp.volume, grasp.isotropy,
        int(grasp.force_closure),
    )


def _detail_values(grasp: Grasp) -> tuple[float | str | bytes, ...]:
    vectors = np.array([[contact.position, contact.normal] for contact in grasp.contacts], dtype="<f8")
    return (
        grasp.hand, grasp.computation_time, grasp.message, json.dumps(grasp.hand_posture.names),
        np.array(grasp.hand_posture.positions, dtype="<f8").tobytes(),
        json.dumps([contact.link for contact in grasp.contacts]), vectors.tobytes(),
    )


def _packed_numbers(stamped: StampedGrasp) -> bytes | None:
    pose = stamped.grasp.T_object_tcp
    return pack_numbers(
        stamped.stamp_ns,
        stamped.grasp.quality,
        *pose.position.tolist(),
        *pose.quaternion_xyzw.tolist(),
    )


def _to_bytes(volume: PackedVolume) -> bytes:
    return volume.astype("<i2").tobytes()


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _to_stamped_grasp(row: tuple[Any, ...], object_id: str) -> StampedGrasp:
    (stamp_ns, outcome, quality, px, py, pz, qx, qy, qz, qw, epsilon, volume, isotropy, closure,
     hand, seconds, message, names, positions, links, vectors) = row  # fmt: skip
    contact_vectors = np.frombuffer(vectors, dtype="<f8").reshape(-1, 2, 3)
    contacts = tuple(
        GraspContact(link, position, normal)
        for link, (position, normal) in zip(json.loads(str(links)), contact_vectors, strict=True)
    )
    joint_positions = np.frombuffer(positions, dtype="<f8").tolist()
    grasp = Grasp(
        T_object_tcp=Pose(np.array([px, py, pz]), np.array([qx, qy, qz, qw])),
        outcome=GraspOutcome(outcome),
        quality=_or_nan(quality),
        epsilon=_or_nan(epsilon),
        volume=_or_nan(volume),
        isotropy=_or_nan(isotropy),
        force_closure=bool(closure),
        contacts=contacts,
        hand_posture=HandPosture(tuple(json.loads(str(names))), tuple(joint_positions)),
        object_id=object_id,
        hand=str(hand),
        computation_time=_or_nan(seconds),
        message=str(message),
    )
    return StampedGrasp(int(stamp_ns), grasp)
