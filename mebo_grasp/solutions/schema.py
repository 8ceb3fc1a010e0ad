"""The tables of an archive, their version, and the steps from each version to the next."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator

from mebo_grasp.errors import ArchiveError
from mebo_grasp.solutions.trial_chunks import pack_all

APPLICATION_ID = 0x4D45424F
"""Written into the database's header: "MEBO"."""

_VERSION_1 = """
CREATE TABLE object (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE session (id INTEGER PRIMARY KEY, begun_ns INTEGER NOT NULL);
CREATE TABLE trial (
    object INTEGER NOT NULL REFERENCES object, stamp_ns INTEGER NOT NULL,
    session INTEGER NOT NULL REFERENCES session, outcome INTEGER NOT NULL, quality REAL,
    px REAL NOT NULL, py REAL NOT NULL, pz REAL NOT NULL,
    qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL, qw REAL NOT NULL,
    epsilon REAL, volume REAL, isotropy REAL, force_closure INTEGER NOT NULL,
    PRIMARY KEY (object, stamp_ns)
) WITHOUT ROWID;
CREATE TABLE trial_detail (
    object INTEGER NOT NULL, stamp_ns INTEGER NOT NULL, hand TEXT NOT NULL, computation_time REAL,
    message TEXT NOT NULL, joint_names TEXT NOT NULL, joint_positions BLOB NOT NULL,
    contact_links TEXT NOT NULL, contact_vectors BLOB NOT NULL,
    PRIMARY KEY (object, stamp_ns)
) WITHOUT ROWID;
"""

# The capsules of the hand in its final posture, as HandVolume.packed() gives them.
_VERSION_2 = "ALTER TABLE trial ADD COLUMN hand_volume BLOB"

# The numbers of a grasp once more as bytes, for a quick start; version 4 does that better.
_VERSION_3 = "ALTER TABLE trial ADD COLUMN numbers BLOB"

# Runs of trials once more as bytes, see trial_chunks. Whoever changes a trial removes the chunk that it stands in.
_FORGET_CHUNK = """DELETE FROM chunk WHERE object = {row}.object AND first_stamp_ns <= {row}.stamp_ns
    AND last_stamp_ns = (SELECT min(last_stamp_ns) FROM chunk
        WHERE object = {row}.object AND last_stamp_ns >= {row}.stamp_ns);"""
_OLD, _NEW = _FORGET_CHUNK.format(row="OLD"), _FORGET_CHUNK.format(row="NEW")
_VERSION_4 = f"""
ALTER TABLE trial DROP COLUMN numbers;
CREATE TABLE chunk (
    object INTEGER NOT NULL REFERENCES object, last_stamp_ns INTEGER NOT NULL,
    first_stamp_ns INTEGER NOT NULL, trials INTEGER NOT NULL, grasps BLOB NOT NULL, volumes BLOB NOT NULL,
    PRIMARY KEY (object, last_stamp_ns, first_stamp_ns)
);
CREATE TRIGGER trial_added AFTER INSERT ON trial BEGIN {_NEW} END;
CREATE TRIGGER trial_changed AFTER UPDATE ON trial BEGIN {_OLD} {_NEW} END;
CREATE TRIGGER trial_deleted AFTER DELETE ON trial BEGIN {_OLD} END;
"""

# What is known of a grasp under noise; NULL when nothing is.
_VERSION_5 = """
ALTER TABLE trial ADD COLUMN expected_quality REAL;
ALTER TABLE trial ADD COLUMN quality_sd REAL;
ALTER TABLE trial ADD COLUMN worst_quality REAL;
ALTER TABLE trial ADD COLUMN noise_samples INTEGER;
DELETE FROM chunk;
"""


def _pack_every_object(connection: sqlite3.Connection) -> None:
    for (object_key,) in connection.execute("SELECT id FROM object").fetchall():
        pack_all(connection, object_key)


Step = str | Callable[[sqlite3.Connection], None]
"""SQL, or what is called with the connection."""

MIGRATIONS: tuple[tuple[Step, ...], ...] = (
    (_VERSION_1,),
    (_VERSION_2,),
    (_VERSION_3,),
    (_VERSION_4,),
    (_VERSION_5, _pack_every_object),  # only the newest step can pack: chunks hold the newest columns
)
"""``MIGRATIONS[v]`` leads from version v to v + 1; version 0 is an empty database."""


def schema_version(connection: sqlite3.Connection) -> int:
    """Return the version of the tables in a database; 0 when it is empty."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    return int(version)


def prepare_schema(
    connection: sqlite3.Connection, path: str, migrations: tuple[tuple[Step, ...], ...] = MIGRATIONS
) -> None:
    """Bring a database to the newest version, all steps in one transaction.

    Args:
        connection: in autocommit mode.
        path: for messages.
        migrations: the steps; ``migrations[v]`` leads from version v to v + 1.

    Raises:
        ArchiveError: the database belongs to another program or to a newer version of this one.
    """
    (application_id,) = connection.execute("PRAGMA application_id").fetchone()
    version = schema_version(connection)
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if application_id != APPLICATION_ID and (application_id or version or tables):
        raise ArchiveError(f"{path} is a database of another program; it is left as it is, name another file")
    if version > len(migrations):
        raise ArchiveError(
            f"{path} has schema version {version}, this program knows up to {len(migrations)}; "
            "use a newer version of mebo_grasp"
        )
    if version == len(migrations):
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        for step in (step for steps in migrations[version:] for step in steps):
            if callable(step):
                step(connection)
                continue
            for statement in _statements(step):
                connection.execute(statement)
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {len(migrations)}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _statements(script: str) -> Iterator[str]:
    """Cut a script where statements end, but not within a trigger."""
    statement = ""
    for piece in script.split(";"):
        statement += piece + ";"
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""
