"""The set-up script's own rules: what it demands, what it redoes, what it refuses."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPT = Path(__file__).resolve().parents[3] / "tools" / "setup_environment.py"


@pytest.fixture
def setup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script as a module, with a small repository of its own."""
    specification = importlib.util.spec_from_file_location("setup_environment", SCRIPT)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    monkeypatch.setitem(sys.modules, "setup_environment", module)
    specification.loader.exec_module(module)
    repository = tmp_path / "repository"
    (repository / "mebo_grasp_interfaces" / "msg").mkdir(parents=True)
    (repository / "mebo_grasp" / "grasping").mkdir(parents=True)
    for name in ("requirements.txt", "requirements-dev.txt", "setup.py", "mebo_grasp_interfaces/msg/A.msg"):
        (repository / name).write_text("first\n")
    monkeypatch.setattr(module, "ROOT", repository)
    return module


def run_script(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    environment = {**os.environ, **variables}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize(
    ("version", "fits"),
    [((3, 10), False), ((3, 11), True), ((3, 12), True), ((3, 13), False), ((3, 9), False), ((4, 0), False)],
)
def test_only_pythons_with_wheels_are_usable(setup: ModuleType, version: tuple[int, int], fits: bool) -> None:
    assert setup.usable(version) is fits


def test_each_missing_thing_is_named_with_its_package(tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    done = run_script("--venv", str(tmp_path / "venv"), PATH=str(tmp_path / "bin"), CC="cc", CXX="c++")
    assert done.returncode == 1
    for text in ("a C compiler", "a C++ compiler", "sudo apt install build-essential make"):
        assert text in done.stderr
    assert not (tmp_path / "venv").exists()


def test_a_compiler_without_headers_is_missing(setup: ModuleType) -> None:
    assert setup.compiles("cc", "c", "#include <stdio.h>\n")
    assert not setup.compiles("cc", "c", "#include <no_such_header.h>\n")
    assert not setup.compiles(None, "c", "")


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    kept = tmp_path / "venv" / "kept"
    kept.parent.mkdir()
    kept.write_text("precious")
    done = run_script("--venv", str(kept.parent))
    assert done.returncode == 1
    assert "was not made by this set-up" in done.stderr
    assert [path.name for path in kept.parent.iterdir()] == ["kept"]
    assert kept.read_text() == "precious"


@pytest.mark.parametrize(
    ("changed", "again"),
    [
        ("requirements.txt", {"requirements", "interfaces", "package", "compiled"}),
        ("requirements-dev.txt", {"test-tools"}),
        ("mebo_grasp_interfaces/msg/A.msg", {"interfaces", "package", "compiled"}),
        ("mebo_grasp_interfaces/msg/New.msg", {"interfaces", "package", "compiled"}),
        ("setup.py", {"package", "compiled"}),
        ("mebo_grasp/grasping/closing.py", {"compiled"}),
        ("README.md", set()),
    ],
)
def test_a_change_makes_just_its_steps_due(setup: ModuleType, tmp_path: Path, changed: str, again: set[str]) -> None:
    env = setup.Environment(tmp_path / "venv")
    before = setup.keys(setup.STEPS, env)
    (setup.ROOT / changed).write_text("second\n")
    after = setup.keys(setup.STEPS, env)
    assert {name for name in before if before[name] != after[name]} == again


def test_another_place_makes_every_step_due(setup: ModuleType, tmp_path: Path) -> None:
    here = setup.keys(setup.STEPS, setup.Environment(tmp_path / "a"))
    there = setup.keys(setup.STEPS, setup.Environment(tmp_path / "b"))
    assert all(here[name] != there[name] for name in here)


def test_finished_steps_are_not_repeated_and_a_failed_one_is(setup: ModuleType, tmp_path: Path) -> None:
    calls: list[str] = []
    fails = [True]

    def first(_: object) -> None:
        calls.append("first")

    def second(_: object) -> None:
        calls.append("second")
        if fails:
            raise setup.SetupError("no network")

    env = setup.Environment(tmp_path / "venv")
    (env.state / "logs").mkdir(parents=True)
    steps = tuple(setup.Step(f.__name__, "", (), (), f) for f in (first, second))
    with pytest.raises(setup.SetupError, match="no network"):
        setup.set_up(env, steps)
    fails.clear()
    setup.set_up(env, steps)
    setup.set_up(env, steps)
    assert calls == ["first", "second", "second"]


def test_whatever_compiled_code_is_made_of_has_it_compiled_anew(setup: ModuleType) -> None:
    repository = Path(__file__).parents[3]
    (step,) = (step for step in setup.STEPS if step.name == "compiled")
    watched = {file for pattern in step.made_from for file in repository.glob(pattern)}
    package, mark = repository / "mebo_grasp", re.compile(r"^@(njit|compiled|borrowing)", re.MULTILINE)
    # What benchmarks compile for themselves need not be there before they run.
    compiled = {f for f in package.rglob("*.py") if mark.search(f.read_text()) and f.parent.name != "benchmarks"}
    assert len(compiled) > 20
    assert compiled | {package / "compiling.py"} <= watched


def test_wheels_cmake_files_get_this_interpreters_include_folders(setup: ModuleType, tmp_path: Path) -> None:
    env = setup.Environment(tmp_path / "venv")
    folder = env.path / "share" / "some_msgs" / "cmake"
    folder.mkdir(parents=True)
    (env.path / "bin").mkdir()
    wrapper = env.path / "bin" / "python"
    wrapper.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    wrapper.chmod(0o755)
    version = "{}.{}".format(*sys.version_info)
    tag = "cp" + version.replace(".", "")
    home, library = f"/opt/python/{tag}-{tag}", f"lib/python{version}/site-packages"
    wheel = f"{home}/include/python{version};{home}/{library}/numpy/_core/include;/usr\n"
    file, untouched = folder / "export.cmake", folder / "other.cmake"
    file.write_text(wheel)
    untouched.write_text("set(x 1)\n")
    os.utime(untouched, (1, 1))
    setup.repair_cmake_paths(env)
    repaired = f"{sysconfig.get_paths()['include']};{np.get_include()};/usr\n"
    assert file.read_text() == repaired
    setup.repair_cmake_paths(env)
    assert file.read_text() == repaired
    assert untouched.stat().st_mtime == 1


def test_a_failing_command_shows_the_end_of_its_log(setup: ModuleType, tmp_path: Path) -> None:
    log = tmp_path / "step.log"
    with pytest.raises(setup.SetupError, match=r"(?s)code 3.*\| the reason.*whole log: .*step\.log"):
        setup.run(["sh", "-c", "echo the reason; exit 3"], log, dict(os.environ))


def test_an_interrupt_ends_a_command_and_its_children(setup: ModuleType) -> None:
    reader, writer = os.pipe()
    command = ["sh", "-c", "sleep 600 & sleep 600"]
    process = subprocess.Popen(command, pass_fds=(writer,), start_new_session=True)
    os.close(writer)
    setup.terminate_group(process)
    assert process.returncode == -signal.SIGTERM
    # The pipe ends when the last process that holds its other side is gone.
    assert os.read(reader, 1) == b""
    os.close(reader)


def test_variables_of_another_ros_do_not_leak_in(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"):
        monkeypatch.setenv(name, "/opt/other")
    monkeypatch.setenv("HTTPS_PROXY", "kept")
    variables = setup.Environment(tmp_path).variables()
    assert "/opt/other" not in variables.values()
    assert variables["AMENT_PREFIX_PATH"] == str(tmp_path)
    assert variables["HTTPS_PROXY"] == "kept"
