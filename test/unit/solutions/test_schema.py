"""Older archives are brought to the newest version with all that they hold."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from mebo_grasp.errors import ArchiveError, InvalidQueryError
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose, QualityUnderNoise, StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import Occlusion, Sphere
from mebo_grasp.solutions.ranking import Ranking
from mebo_grasp.solutions.schema import MIGRATIONS, prepare_schema, schema_version
from mebo_grasp.solutions.trial_chunks import CHUNK_TRIALS

BALL = HandVolume(np.array([[0.0, 0.0, -0.05]]), np.array([[0.0, 0.0, -0.05]]), np.array([0.02]))
BEHIND = Occlusion("behind", Sphere(0.02), Pose(np.array([0.0, 0.0, -0.08])))
BY_HAND = BestGraspQuery((BEHIND,), rule=BlockingRule.HAND)


def make_version_1(path: Path) -> None:
    """Write an archive as version 1 did: one grasp, one worthless trial, one that failed."""
    connection = sqlite3.connect(path, isolation_level=None)
    prepare_schema(connection, str(path), MIGRATIONS[:1])
    connection.execute("INSERT INTO object (id, name) VALUES (1, 'bottle')")
    connection.execute("INSERT INTO session (id, begun_ns) VALUES (1, 5)")
    for stamp, outcome, quality in ((10, 0, 0.5), (11, 1, 0.0), (12, 3, None)):
        connection.execute(
            "INSERT INTO trial VALUES (1, ?, 1, ?, ?, 0, 0, 0, 0, 0, 0, 1, ?, ?, ?, 0)",
            (stamp, outcome, quality, quality, quality, quality),
        )
        connection.execute("INSERT INTO trial_detail VALUES (1, ?, 'icub', 0.1, '', '[]', x'', '[]', x'')", (stamp,))
    connection.close()


def test_an_archive_of_version_1_keeps_its_trials_and_learns_hand_volumes(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    make_version_1(path)
    with SolutionArchive(path, "bottle") as archive:
        assert [s.stamp_ns for s in archive.grasps] == [10, 11, 12]
        with pytest.raises(InvalidQueryError, match="hand_volume"):
            archive.best(BY_HAND)
    with SolutionArchive(path, "bottle", hand_volume=lambda _: BALL) as archive:
        assert archive.best(BY_HAND).occluded == 1
        assert len(archive.best(BestGraspQuery((BEHIND,))).grasps) == 1
    connection = sqlite3.connect(path)
    assert schema_version(connection) == len(MIGRATIONS) == 5
    (stored,) = connection.execute("SELECT hand_volume FROM trial WHERE stamp_ns = 10").fetchone()
    connection.close()
    np.testing.assert_array_equal(np.frombuffer(stored, "<i2").reshape(-1, 7), BALL.packed())


def test_a_step_that_fails_leaves_the_older_version_whole(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    make_version_1(path)
    connection = sqlite3.connect(path, isolation_level=None)
    broken = (MIGRATIONS[0], ("ALTER TABLE trial ADD COLUMN extra BLOB; DROP TABLE missing",))
    with pytest.raises(sqlite3.OperationalError, match="missing"):
        prepare_schema(connection, str(path), broken)
    assert schema_version(connection) == 1
    columns = [row[1] for row in connection.execute("PRAGMA table_info(trial)")]
    connection.close()
    assert "extra" not in columns
    with SolutionArchive(path, "bottle") as archive:
        assert len(archive) == 3


def test_sessions_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    for first in (0, 10):
        with SolutionArchive(path, "bottle") as archive:
            for stamp in range(first, first + 3):
                archive.add(StampedGrasp(stamp, Grasp(Pose.identity(), GraspOutcome.NO_CONTACT, 0.0)))
    with SolutionArchive(path, "bottle") as archive:  # opening alone makes no session
        assert [(session.id, session.trials) for session in archive.sessions] == [(1, 3), (2, 3)]
        assert archive.sessions[0].begun_ns <= archive.sessions[1].begun_ns


def test_a_trial_that_was_changed_by_hand_is_read_as_it_is_now(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    with SolutionArchive(path, "bottle") as archive:
        archive.add_many(StampedGrasp(stamp, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5)) for stamp in range(600))
    connection = sqlite3.connect(path)
    chunks = "SELECT count(*), sum(trials) FROM chunk"
    assert connection.execute(chunks).fetchone() == (2, 2 * CHUNK_TRIALS)
    connection.execute("UPDATE trial SET quality = 0.75 WHERE stamp_ns = 100")
    connection.execute("DELETE FROM trial WHERE stamp_ns = 300")
    connection.commit()
    connection.close()
    with SolutionArchive(path, "bottle") as archive:
        assert len(archive) == 599
        assert [s.stamp_ns for s in archive.best().grasps] == [100]


@pytest.mark.parametrize("version", [3, 4])
def test_an_older_archive_is_packed_anew_when_it_is_opened(tmp_path: Path, version: int) -> None:
    path = tmp_path / "archive.db"
    connection = sqlite3.connect(path, isolation_level=None)
    prepare_schema(connection, str(path), MIGRATIONS[:version])
    connection.execute("INSERT INTO object (id, name) VALUES (1, 'bottle')")
    for stamp in range(CHUNK_TRIALS + 1):
        connection.execute(
            "INSERT INTO trial (object, stamp_ns, session, outcome, quality, px, py, pz, qx, qy, qz, qw, "
            "force_closure) VALUES (1, ?, 1, 0, ?, 0, 0, 0, 0, 0, 0, 1, 0)",
            (stamp, 0.001 * (stamp + 1)),
        )
        connection.execute("INSERT INTO trial_detail VALUES (1, ?, 'icub', 0.1, '', '[]', x'', '[]', x'')", (stamp,))
    if version == 4:  # of grasps that are shorter
        connection.execute("INSERT INTO chunk VALUES (1, 255, 0, 256, x'00000000', x'00000000')")
    connection.close()
    with SolutionArchive(path, "bottle") as archive:
        assert len(archive) == CHUNK_TRIALS + 1
        assert {stamped.grasp.under_noise for stamped in archive.grasps} == {None}
        assert archive.best(BestGraspQuery(min_quality=0.2565)).considered == 1
    connection = sqlite3.connect(path)
    assert connection.execute("SELECT trials FROM chunk").fetchall() == [(CHUNK_TRIALS,)]
    connection.close()


def test_figures_under_noise_are_found_again_in_chunks_and_behind_them(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    known = {3: QualityUnderNoise(0.4, 0.2, 0.1, 5), CHUNK_TRIALS: QualityUnderNoise(0.3, 0.1, 0.2, 7)}
    with SolutionArchive(path, "bottle") as archive:
        archive.add_many(
            StampedGrasp(stamp, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, under_noise=known.get(stamp)))
            for stamp in range(CHUNK_TRIALS + 1)
        )
    with SolutionArchive(path, "bottle") as archive:
        for ranking, stamps in ((Ranking.EXPECTED, [3, CHUNK_TRIALS]), (Ranking.WORST, [CHUNK_TRIALS, 3])):
            answer = archive.best(BestGraspQuery(max_grasps=9, ranking=ranking))
            assert [s.stamp_ns for s in answer.grasps] == stamps
            assert [s.grasp.under_noise for s in answer.grasps] == [known[stamp] for stamp in stamps]
            assert answer.passed_over == CHUNK_TRIALS - 1
    connection = sqlite3.connect(path)
    assert connection.execute("SELECT trials FROM chunk").fetchall() == [(CHUNK_TRIALS,)]
    connection.close()


def test_a_damaged_chunk_is_told(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    with SolutionArchive(path, "bottle") as archive:
        for stamp in range(CHUNK_TRIALS):
            archive.add(StampedGrasp(stamp, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5)))
    connection = sqlite3.connect(path)
    (blob,) = connection.execute("SELECT grasps FROM chunk").fetchone()
    changed = bytearray(blob)
    changed[40] ^= 1
    connection.execute("UPDATE chunk SET grasps = ?", (bytes(changed),))
    connection.commit()
    connection.close()
    with pytest.raises(ArchiveError, match="wrong checksum"):
        SolutionArchive(path, "bottle")
