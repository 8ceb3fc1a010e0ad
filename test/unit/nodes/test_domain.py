"""DDS domains are shared by all users of a machine, who cannot write one another's files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.nodes import domain
from mebo_grasp.nodes.domain import private_domain

OTHER_USER = """
import os
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.nodes.domain import private_domain
if os.geteuid() == 0:
    os.setuid(65534)
with private_domain() as domain_id:
    print(domain_id)
"""


@pytest.fixture
def shared_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in which everybody may make files, and nobody touch those of others."""
    folder = Path("/var/tmp") / f"mebo_grasp_domains_{os.getpid()}"
    folder.mkdir()
    folder.chmod(0o1777)
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    shutil.rmtree(folder)


def domain_of_another_user(folder: Path) -> str:
    environment = os.environ | {"TMPDIR": str(folder)}
    done = subprocess.run([sys.executable, "-c", OTHER_USER], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_users_leave_one_another_their_domains_and_share_those_that_are_free(shared_folder: Path) -> None:
    with private_domain() as first, private_domain() as second:
        assert (first, second) == (1, 2)
        assert domain_of_another_user(shared_folder) == "3\n"
    assert domain_of_another_user(shared_folder) == "1\n"


def test_a_file_that_cannot_be_locked_costs_one_domain_and_all_of_them_are_an_error(
    shared_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (shared_folder / "mebo_grasp_domain_1.lock").mkdir()
    with private_domain() as domain_id:
        assert domain_id == 2
    monkeypatch.setattr(domain, "DOMAIN_IDS", range(1, 2))
    with pytest.raises(InvalidSettingsError, match=f"1 to 1 are in use.*{shared_folder}"), private_domain():
        pass
