"""Broken files, full disks, second writers and death at any instant: a clear error, and nothing lost."""

import contextlib
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from mebo_grasp.errors import ArchiveError
from mebo_grasp.solutions.archive import SolutionArchive
from test.property.solution_strategies import many_grasps

KILLS = int(os.environ.get("MEBO_GRASP_KILLS", "8"))
"""How often the writer is killed; the whole run is 200 (``make soak``)."""
DAMAGES = int(os.environ.get("MEBO_GRASP_DAMAGES", "6"))
"""How many files are damaged at random; the whole run is 100."""

REPOSITORY = Path(__file__).resolve().parents[2]

WRITER = """
import itertools
import sys
import threading
import numpy as np
from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from test.property.solution_strategies import many_grasps
first = int(sys.argv[2])
trials = many_grasps(500, np.random.default_rng(3))
with SolutionArchive(sys.argv[1], "bottle") as archive:
    def ask():
        while True:  # somebody asks all the time
            archive.solution_set(4, 0.04)
    threading.Thread(target=ask, daemon=True).start()
    print("open", flush=True)
    for i in itertools.count(first):
        stamp_ns = trials[0].stamp_ns + i
        archive.add(StampedGrasp(stamp_ns, trials[i % 500].grasp))
        print(stamp_ns, flush=True)
"""


def child(code: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), *arguments],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def acknowledged_until_killed(database: Path, first: int, delay: float) -> list[int]:
    """Start a writer, kill it ``delay`` seconds after it is ready, return the stamps it acknowledged."""
    process = child(WRITER, str(database), str(first))
    assert process.stdout is not None
    assert process.stdout.readline() == "open\n", process.communicate()[1]
    timer = subprocess.Popen(["sh", "-c", f"sleep {delay:.4f}; kill -9 {process.pid}"])
    lines = process.stdout.read().splitlines()
    timer.wait()
    assert process.wait() == -signal.SIGKILL
    if process.stderr is not None:
        process.stderr.close()
    return [int(line) for line in lines if len(line) == 19]


def test_killed_at_random_instants_it_loses_no_acknowledged_trial(tmp_path: Path) -> None:
    database = tmp_path / "archive.db"
    draw = random.Random(5)
    acknowledged: set[int] = set()
    for _ in range(KILLS):
        acknowledged.update(acknowledged_until_killed(database, len(acknowledged), draw.uniform(0, 0.15)))
        with SolutionArchive(database, "bottle") as archive:
            count = len(archive)
        with contextlib.closing(sqlite3.connect(database)) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            stored = {stamp for (stamp,) in connection.execute("SELECT stamp_ns FROM trial")}
        assert acknowledged <= stored
        assert count == len(stored)
        # At most one trial more: written, but its acknowledgement was never read.
        assert len(stored - acknowledged) <= 1
        acknowledged = stored
    with SolutionArchive(database, "bottle") as archive:
        assert {stamped.stamp_ns for stamped in archive.grasps} == acknowledged
    assert acknowledged


def fill(path: Path, count: int = 50) -> None:
    with SolutionArchive(path, "bottle") as archive:
        for stamped in many_grasps(count, np.random.default_rng(0)):
            archive.add(stamped)


def test_a_full_disk_refuses_the_trial_and_keeps_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    fill(path)
    code = """
    import resource, sys
    import numpy as np
    from mebo_grasp.errors import ArchiveError
    from mebo_grasp.solutions.archive import SolutionArchive
    from test.property.solution_strategies import many_grasps
    trials = many_grasps(5000, np.random.default_rng(0))[50:]
    archive = SolutionArchive(sys.argv[1], "bottle")
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    stored = 50
    try:
        for trial in trials:
            archive.add(trial)
            stored += 1
    except ArchiveError as error:
        message = str(error)
    assert len(archive) == stored and len(archive.best().grasps) == 1
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert archive.add(trials[-1])  # there is space again
    archive.close()
    print(stored + 1, message)
    """
    process = child(code, str(path))
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    stored, _, message = output.partition(" ")
    assert "free space on the disk" in message
    with SolutionArchive(path, "bottle") as archive:
        assert len(archive) == int(stored) > 51


def may_mount() -> bool:
    """Whether this user may mount a file system that only a child sees."""
    command = ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    return shutil.which("unshare") is not None and (
        subprocess.run(command, capture_output=True, check=False).returncode == 0
    )


def test_a_file_system_without_space_refuses_the_trial_and_keeps_the_rest(tmp_path: Path) -> None:
    if not may_mount():
        pytest.skip("mounting a small file system is not allowed here")
    code = """
    import shutil, sys
    from pathlib import Path
    import numpy as np
    from mebo_grasp.errors import ArchiveError
    from mebo_grasp.solutions.archive import SolutionArchive
    from test.property.solution_strategies import many_grasps
    trials = many_grasps(5000, np.random.default_rng(0))
    disk = Path(sys.argv[1])
    (disk / "filler").write_bytes(b"x" * 500_000)
    archive, stored = SolutionArchive(disk / "archive.db", "bottle"), 0
    try:
        for trial in trials:
            archive.add(trial)
            stored += 1
    except ArchiveError as error:
        message = str(error)
    assert len(archive) == stored and len(archive.best().grasps) == 1
    (disk / "filler").unlink()
    assert archive.add(trials[-1])  # there is space again
    archive.close()
    shutil.copy(disk / "archive.db", sys.argv[2])
    print(stored + 1, message)
    """
    script = 'mount -t tmpfs -o size=2m tmpfs "$1" && exec "$0" -c "$3" "$1" "$2"'
    disk, kept = tmp_path / "disk", tmp_path / "kept.db"
    disk.mkdir()
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script, sys.executable, str(disk), str(kept), textwrap.dedent(code)],
        cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    stored, _, message = done.stdout.partition(" ")
    assert "free space on the disk" in message
    with SolutionArchive(kept, "bottle") as archive:
        found = [stamped.stamp_ns for stamped in archive.grasps]
    assert len(found) == int(stored) > 51
    assert found[:-1] == [s.stamp_ns for s in many_grasps(5000, np.random.default_rng(0))[: len(found) - 1]]


@pytest.mark.parametrize("content", [b"timestamp,quality\n1,2\n" * 100, b"\x00" * 4096, b"x"])
def test_a_file_that_is_no_database_is_refused_and_left(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.db"
    path.write_bytes(content)
    with pytest.raises(ArchiveError, match="not an SQLite database"):
        SolutionArchive(path, "bottle")
    assert path.read_bytes() == content
    assert [file.name for file in tmp_path.iterdir()] == ["notes.db"]


def test_a_database_of_another_program_is_refused_and_left(tmp_path: Path) -> None:
    path = tmp_path / "photos.db"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE photo (id INTEGER)")
    connection.commit()
    connection.close()
    before = path.read_bytes()
    with pytest.raises(ArchiveError, match="another program"):
        SolutionArchive(path, "bottle")
    assert path.read_bytes() == before


def test_an_archive_of_a_newer_version_is_refused_and_left(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    fill(path)
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(ArchiveError, match="schema version 99"):
        SolutionArchive(path, "bottle")
    assert path.read_bytes() == before


def stamps_or_error(path: Path) -> set[int] | ArchiveError:
    try:
        with SolutionArchive(path, "bottle") as archive:
            return {stamped.stamp_ns for stamped in archive.grasps}
    except ArchiveError as error:
        return error


@pytest.mark.parametrize("seed", range(DAMAGES))
def test_a_damaged_file_gives_an_error_or_the_stored_trials(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "archive.db"
    fill(path, 400)
    whole = {s.stamp_ns for s in many_grasps(400, np.random.default_rng(0))}
    damaged = bytearray(path.read_bytes())
    draw = random.Random(seed)
    begin = draw.randrange(4096, len(damaged) - 8192)
    damaged[begin : begin + 8192] = draw.randbytes(8192)
    path.write_bytes(damaged)
    # Pages that nobody needs may be hit: then the trials are all there, else the error names the file.
    found = stamps_or_error(path)
    assert found == whole or str(path) in str(found)
    assert path.read_bytes() == bytes(damaged)


def test_a_truncated_file_gives_an_error(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    fill(path, 400)
    cut = path.read_bytes()[:20_000]
    path.write_bytes(cut)
    with pytest.raises(ArchiveError, match="damaged"):
        SolutionArchive(path, "bottle")
    assert path.read_bytes() == cut


def test_a_second_writer_is_told_who_holds_the_archive(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    with SolutionArchive(path, "bottle"):
        with pytest.raises(ArchiveError, match=f"in use by process {os.getpid()}"):
            SolutionArchive(path, "bottle")
        process = child(WRITER, str(path), "0")
        _, errors = process.communicate(timeout=120)
        assert process.returncode != 0
        assert f"in use by process {os.getpid()}" in errors
    fill(path)  # free again


def test_a_refused_second_writer_leaves_the_locks_of_the_first(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    fill(path)
    with SolutionArchive(path, "bottle"):
        with pytest.raises(ArchiveError, match="in use"):
            SolutionArchive(path, "bottle")
        # Another program could otherwise take the write-ahead log away from under the first one.
        other = child("import sqlite3, sys; sqlite3.connect(sys.argv[1], timeout=0).execute(sys.argv[2])",
                      str(path), "PRAGMA journal_mode = DELETE")  # fmt: skip
        assert "database is locked" in other.communicate(timeout=60)[1]


def test_on_a_disk_without_any_space_an_archive_is_opened_and_closed_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "archive.db"
    fill(path)
    code = """
    import resource, sys
    from mebo_grasp.errors import ArchiveError
    from mebo_grasp.solutions.archive import SolutionArchive
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    try:
        SolutionArchive(sys.argv[1], "bottle")
    except ArchiveError as error:
        print(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    with SolutionArchive(sys.argv[1], "bottle") as archive:
        print(len(archive))
    """
    output, errors = child(code, str(path)).communicate(timeout=120)
    assert errors == ""
    message, count = output.splitlines()
    assert "free space on the disk" in message
    assert count == "50"


@pytest.mark.parametrize("change", ["quality = 'good'", "hand_volume = 5"])
def test_values_of_a_wrong_kind_give_an_error(tmp_path: Path, change: str) -> None:
    path = tmp_path / "archive.db"
    fill(path)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute(f"UPDATE trial SET {change} WHERE quality > 0")
        connection.commit()
    with pytest.raises(ArchiveError, match="the file is damaged"):
        SolutionArchive(path, "bottle")


def test_folders_and_missing_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="is a folder"):
        SolutionArchive(tmp_path, "bottle")
    with pytest.raises(ArchiveError, match="does not exist"):
        SolutionArchive(tmp_path / "missing" / "archive.db", "bottle")


def test_a_read_only_file_is_refused_and_left() -> None:
    code = """
    import os, sys
    from pathlib import Path
    from mebo_grasp.errors import ArchiveError
    from mebo_grasp.solutions.archive import SolutionArchive
    if os.geteuid() == 0:
        os.setuid(65534)  # root may write everywhere
    try:
        SolutionArchive(sys.argv[1], "bottle")
    except ArchiveError as error:
        print(error)
    """
    folder = Path("/var/tmp") / f"mebo_grasp_read_only_{os.getpid()}"
    folder.mkdir(mode=0o755)
    try:
        path = folder / "archive.db"
        fill(path)
        path.chmod(0o444)
        before = path.read_bytes()
        for mode in (0o555, 0o777):  # the folder read-only as well, then only the file
            folder.chmod(mode)
            process = child(code, str(path))
            output, errors = process.communicate(timeout=120)
            assert "cannot be opened for writing: Permission denied" in output, errors
            assert path.read_bytes() == before
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)
