"""Both packages built with colcon in a workspace, as a ROS user does, then used after sourcing it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from .harness import WAIT, Probe, wait_until

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = Path(sys.prefix)
NODES = ("optimizer_node", "hand_node", "solution_set_node")
BUILD_LIMIT = 280.0
# A new installation has no compiled numba functions yet: nodes take their time to start and to end.
START_LIMIT = STOP_LIMIT = 120.0

pytestmark = [
    pytest.mark.slow,
    pytest.mark.nodes,
    pytest.mark.skipif(not (ENVIRONMENT / "bin" / "colcon").exists(), reason="needs colcon (`make setup`)"),
]


def clean_environment(**more: str) -> dict[str, str]:
    """What a fresh shell of this user holds; the virtual environment stands in for /opt/ros."""
    kept = {name: os.environ[name] for name in ("HOME", "LANG", "CC", "CXX", "TMPDIR") if name in os.environ}
    path = f"{ENVIRONMENT / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
    prefix = str(ENVIRONMENT)
    return {**kept, "PATH": path, "AMENT_PREFIX_PATH": prefix, "CMAKE_PREFIX_PATH": prefix, **more}


def sourced(workspace: Path, script: str) -> list[str]:
    """A command that sources the workspace and runs a line of bash."""
    return ["bash", "-c", f". {workspace}/install/setup.bash && {script}"]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository, built by a plain `colcon build` in it."""
    folder = tmp_path_factory.mktemp("workspace") / "mebo_grasp"
    unwanted = (".*", "build", "install", "log", "out", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*unwanted))
    python = f"-DPython3_EXECUTABLE={sys.executable}"
    done = subprocess.run(
        ["colcon", "build", "--cmake-args", python, "-DBUILD_TESTING=OFF"],
        cwd=folder,
        env=clean_environment(COLCON_HOME=str(folder / "colcon_home"), MAKEFLAGS=f"-j{os.cpu_count()}"),
        capture_output=True,
        text=True,
        timeout=BUILD_LIMIT,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return folder


def test_nodes_and_command_are_where_ros2_run_looks(workspace: Path) -> None:
    folder = workspace / "install" / "mebo_grasp" / "lib" / "mebo_grasp"
    found = {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}
    assert found == {*NODES, "mebo-grasp"}


@pytest.mark.parametrize("package", ["mebo_grasp", "mebo_grasp_interfaces"])
def test_ament_index_names_the_package(workspace: Path, package: str) -> None:
    prefix = workspace / "install" / package
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / package).is_file()
    assert (prefix / "share" / package / "package.xml").is_file()


def test_parameter_files_are_in_share(workspace: Path) -> None:
    share = workspace / "install" / "mebo_grasp" / "share" / "mebo_grasp" / "params"
    wanted, installed = (
        {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.yaml")}
        for folder in (ROOT / "params", share)
    )
    assert {f"{node}.yaml" for node in NODES} <= wanted.keys()
    assert installed == wanted


@pytest.mark.parametrize("package", ["mebo_grasp", "msg_adapters"])
def test_every_file_of_the_packages_is_installed(workspace: Path, package: str) -> None:
    version = "python{}.{}".format(*sys.version_info)
    installed = workspace / "install" / "mebo_grasp" / "lib" / version / "site-packages"
    missing = [
        str(path.relative_to(workspace))
        for path in (workspace / package).rglob("*")
        if path.is_file() and not (installed / path.relative_to(workspace)).is_file()
    ]
    assert missing == []


def test_sourced_workspace_imports_from_its_own_folders(workspace: Path, tmp_path: Path) -> None:
    script = (
        "import mebo_grasp, msg_adapters, mebo_grasp_interfaces.msg as m, mebo_grasp_interfaces.srv as s; "
        "from rclpy.serialization import deserialize_message, serialize_message; "
        "quality = m.GraspQuality(quality=0.25, contacts=[m.GraspContact(link='thumb')]); "
        "back = deserialize_message(serialize_message(quality), m.GraspQuality); "
        "assert back == quality and s.GetBestGrasp.Request().max_grasps >= 0; "
        "print(mebo_grasp.__file__, msg_adapters.__file__, m.__file__, sep='\\n')"
    )
    done = subprocess.run(
        sourced(workspace, f'python -c "{script}"'),
        cwd=tmp_path, env=clean_environment(), capture_output=True, text=True, timeout=WAIT * 4, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    files = done.stdout.splitlines()[-3:]
    assert len(files) == 3
    assert all(Path(file).is_relative_to(workspace / "install") for file in files), files


@pytest.fixture
def start(workspace: Path, tmp_path: Path, domain_id: int) -> Iterator[Callable[[str], Path]]:
    """Start an installed node with its installed parameter file; gives its log. All end with the test."""
    processes: dict[Path, subprocess.Popen[bytes]] = {}
    ros: Mapping[str, str] = {
        "ROS_DOMAIN_ID": str(domain_id),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "HOME": str(tmp_path),
    }

    def start_node(node: str) -> Path:
        package = workspace / "install" / "mebo_grasp"
        arguments = f"--ros-args --params-file {package}/share/mebo_grasp/params/{node}.yaml"
        log = tmp_path / f"{node}.log"
        with log.open("wb") as output:
            command = sourced(workspace, f"exec {package}/lib/mebo_grasp/{node} {arguments}")
            environment = clean_environment(**ros)
            process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=output, stderr=output)
        processes[log] = process
        return log

    yield start_node
    for process in processes.values():
        process.send_signal(signal.SIGINT)
    silent = []
    for log, process in processes.items():
        try:
            process.wait(STOP_LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            silent.append(f"{log.name} did not end:\n{log.read_text()}")
    assert not silent, "\n".join(silent)


def test_installed_nodes_start_with_their_parameter_files(start: Callable[[str], Path], probe: Probe) -> None:
    logs = {node: start(node) for node in NODES}

    def missing() -> set[str]:
        return set(NODES) - set(probe.node.get_node_names())

    def story() -> str:
        return f"nodes {missing()}; logs: " + "\n".join(log.read_text() for log in logs.values())

    wait_until(lambda: not missing(), START_LIMIT, story)
    assert not missing(), story()
