"""Importing the simulator prints nothing, and errors are still seen."""

import os
import subprocess
import sys

import pytest

from mebo_grasp.grasping.quiet_import import quiet_stderr


def test_importing_the_simulator_prints_nothing() -> None:
    command = [sys.executable, "-c", "import mebo_grasp.grasping.bullet_world"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""


def test_what_is_written_before_and_after_is_seen(capfd: pytest.CaptureFixture[str]) -> None:
    os.write(2, b"before ")
    with quiet_stderr():
        os.write(2, b"within ")
    os.write(2, b"after")
    assert capfd.readouterr().err == "before after"


def test_an_error_passes_and_stderr_is_back(capfd: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        with quiet_stderr():
            raise ImportError("no such library")

    with pytest.raises(ImportError, match="no such library"):
        fail()
    os.write(2, b"here")
    assert capfd.readouterr().err == "here"
