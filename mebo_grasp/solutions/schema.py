"""The tables of an archive, their version, and the steps from each version to the next."""

from __future__ import annotations

import sqlite3

from mebo_grasp.errors import ArchiveError
from mebo_grasp.solutions.stored_grasps import pack_numbers

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

# The numbers of a grasp once more as bytes, see stored_grasps; NULL without a quality above 0.
_VERSION_3 = """
ALTER TABLE trial ADD COLUMN numbers BLOB;
UPDATE trial SET numbers = pack_numbers(stamp_ns, quality, px, py, pz, qx, qy, qz, qw);
"""

MIGRATIONS: tuple[str, ...] = (_VERSION_1, _VERSION_2, _VERSION_3)
"""``MIGRATIONS[v]`` leads from version v to v + 1; version 0 is an empty database."""


def schema_version(connection: sqlite3.Connection) -> int:
    """Return the version of the tables in a database; 0 when it is empty."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    return int(version)


def prepare_schema(
    connection: sqlite3.Connection, path: str, migrations: tuple[str, ...] = MIGRATIONS
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
        raise ArchiveError(
            f"{path} is a database of another program; it is left as it is, name another file"
        )
    if version > len(migrations):
        raise ArchiveError(
            f"{path} has schema version {version}, this program knows up to {len(migrations)}; "
            "use a newer version of mebo_grasp"
        )
    if version == len(migrations):
        return
    connection.create_function("pack_numbers", 9, pack_numbers, deterministic=True)
    connection.execute("BEGIN IMMEDIATE")
    try:
        for step in migrations[version:]:
            for statement in filter(str.strip, step.split(";")):
                connection.execute(statement)
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {len(migrations)}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
