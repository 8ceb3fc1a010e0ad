"""``mebo-grasp`` as a user runs it: whole explorations, Ctrl-C, resuming, and mistakes."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery

from .harness import WAIT, wait_until

COMMAND = str(Path(sys.executable).parent / "mebo-grasp")
PNG = b"\x89PNG\r\n\x1a\n"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=180)


def nodes_of(folder: Path) -> list[str]:
    """Return the command lines of running nodes that were started for a folder."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (OSError, UnicodeDecodeError):
            continue
        if str(folder) in line and "mebo_grasp.nodes" in line:
            found.append(line)
    return found


@pytest.mark.nodes
def test_explore_prints_the_set_and_what_is_left_under_occlusion_and_show_repeats_it(tmp_path: Path) -> None:
    done = run("explore", "--budget", "30", "--initial", "20", "--seed", "2", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    assert "30/30 trials" in done.stderr
    assert "30 trials stored" in done.stdout
    assert "with the top occluded" in done.stdout
    assert "with top and middle occluded" in done.stdout
    picture = tmp_path / "run" / "grasps.png"
    assert picture.read_bytes().startswith(PNG)
    assert nodes_of(tmp_path) == []

    picture.unlink()
    shown = run("show", tmp_path / "run")
    assert shown.returncode == 0, shown.stderr
    rows = re.findall(r"^ +\d+  .*$", done.stdout, flags=re.MULTILINE)
    assert all(row in done.stdout for row in re.findall(r"^ +\d+  .*$", shown.stdout, flags=re.MULTILINE))
    assert rows
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.nodes
def test_explore_judges_by_the_metric_chosen_and_does_not_mix_metrics_in_a_folder(tmp_path: Path) -> None:
    arguments = ["explore", "--budget", "20", "--initial", "20", "--engine", "fast", "--out", str(tmp_path / "run")]
    done = run(*arguments, "--metric", "simox_epsilon")
    assert done.returncode == 0, done.stderr
    with SolutionArchive(tmp_path / "run" / "trials.db", "bottle") as archive:
        grasps = [stamped.grasp for stamped in archive.best(BestGraspQuery((), 20)).grasps]
    assert grasps
    assert all(grasp.quality > grasp.epsilon for grasp in grasps)

    refused = run(*arguments, "--metric", "epsilon")
    assert refused.returncode == 2
    assert "--metric simox_epsilon, not epsilon" in refused.stderr


@pytest.mark.nodes
def test_explore_stays_within_the_bounds_that_are_given(tmp_path: Path) -> None:
    arguments = ["explore", "--budget", "24", "--initial", "12", "--out", str(tmp_path / "run")]
    done = run(*arguments, "--bounds", "z=0.01:0.03")
    assert done.returncode == 0, done.stderr
    assert "z 0.010 to 0.030 m" in done.stdout
    assert run("export", tmp_path / "run", tmp_path / "trials.csv").returncode == 0
    with (tmp_path / "trials.csv").open(newline="") as stream:
        heights = [float(trial["pz"]) for trial in csv.DictReader(stream)]
    assert len(heights) == 24
    assert all(0.01 <= height <= 0.03 for height in heights)

    refused = run(*arguments)
    assert refused.returncode == 2
    assert "was made with --bounds" in refused.stderr


@pytest.mark.nodes
def test_ctrl_c_keeps_what_was_found_and_the_same_command_resumes(tmp_path: Path) -> None:
    arguments = [COMMAND, "explore", "--budget", "150", "--out", str(tmp_path / "run")]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    log = tmp_path / "run" / "run.jsonl"
    wait_until(lambda: log.exists() and log.read_text().count('"tell"') >= 10)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 130, errors
    assert "kept" in output
    assert "Traceback" not in errors
    assert nodes_of(tmp_path) == []
    with SolutionArchive(tmp_path / "run" / "trials.db", "bottle") as archive:
        kept = len(archive)
    assert 10 <= kept <= 150
    resumed = run(*arguments[1:])
    assert resumed.returncode == 0, resumed.stderr
    stored = re.search(r"(\d+) trials stored", resumed.stdout)
    assert stored is not None
    assert int(stored.group(1)) >= 150
    finished = run(*arguments[1:])
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("150/150 trials") == 1
    more = run(*arguments[1:], "--budget", "160")
    assert more.returncode == 0, more.stderr
    assert "its budget is raised from 150 to 160 trials" in more.stdout
    assert "160/160 trials" in more.stderr
    less = run(*arguments[1:])
    assert less.returncode == 2
    assert "--budget 160, not 150" in less.stderr
    arguments += ["--budget", "160"]
    other = run(*arguments[1:], "--seed", "9", "--method", "random")
    assert other.returncode == 2
    assert "--method basin_search, not random and --seed 1, not 9: give the same" in other.stderr


HELD_BACK = """
import os, sys, time
if "mebo_grasp.nodes.solution_set_node" in sys.orig_argv:
    while not os.path.exists(os.environ["RELEASE"]):
        time.sleep(0.01)
"""


@pytest.mark.nodes
def test_ctrl_c_before_the_solution_set_node_is_up_loses_no_trial(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(HELD_BACK)
    release, log = tmp_path / "release", tmp_path / "run" / "run.jsonl"
    process = subprocess.Popen(
        [COMMAND, "explore", "--budget", "150", "--out", str(tmp_path / "run")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(tmp_path), "RELEASE": str(release)},
    )
    wait_until(lambda: log.exists() and log.read_text().count('"tell"') >= 3)
    process.send_signal(signal.SIGINT)
    release.touch()
    output, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 130, errors
    told = log.read_text().count('"tell"')
    assert f"{told} trials stored" in output
    with SolutionArchive(tmp_path / "run" / "trials.db", "bottle") as archive:
        assert len(archive) == told


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["explore", "--object", "unicorn"], "unicorn"),
        (["explore", "--object", "bottle", "--method", "guessing"], "guessing"),
        (["explore", "--budget", "0"], "budget"),
        (["explore", "--kernel", "evidence", "--learning", "mcmc"], "leave these at their defaults"),
        (["explore", "--hand", "claw"], "claw"),
        (["explore", "--bounds", "z=1"], "NAME=LOW:HIGH"),
        (["show", "no/such/folder"], "no/such/folder"),
        (["dance"], "dance"),
        ([], "COMMAND"),
    ],
)
def test_mistakes_are_named_and_leave_no_folder(arguments: list[str], expected: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [COMMAND, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": ""},
    )
    assert done.returncode in (1, 2)
    assert expected in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_command() -> None:
    done = run("--help")
    assert done.returncode == 0
    assert all(command in done.stdout for command in ("explore", "show"))
