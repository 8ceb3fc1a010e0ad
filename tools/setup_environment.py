"""Make the virtual environment of mebo_grasp: requirements, typed interfaces, the package itself.

Needs nothing but the standard library. Each step keeps a stamp with the hash of what it was made
from, so a second run does only what has changed. `make setup` runs this file.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).resolve().parent.parent
OLDEST, BEYOND_NEWEST = (3, 11), (3, 13)  # the ROS 2 Jazzy wheels exist for CPython 3.11 and 3.12
PACKAGE, INTERFACES = "mebo_grasp", "mebo_grasp_interfaces"
NODES = ("optimizer_node", "hand_node", "solution_set_node")
FAILED, INTERRUPTED = 1, 130

# Variables of a sourced ROS workspace, another environment or a user's colcon would leak into the build.
FOREIGN_VARIABLES = (
    "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "COLCON_DEFAULTS_FILE", "LD_LIBRARY_PATH",
    "PIP_PREFIX", "PIP_REQUIRE_VIRTUALENV", "PIP_TARGET", "PIP_USER", "PYTHONHOME", "PYTHONPATH",
    "ROS_DISTRO", "ROS_PYTHON_VERSION", "ROS_VERSION", "VIRTUAL_ENV", "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)  # fmt: skip

# The wheels' CMake files name the include folders of the machine that built them.
WHEEL_PYTHON_INCLUDE = "/opt/python/{tag}-{tag}/include/python{version}"
WHEEL_NUMPY_INCLUDE = "/opt/python/{tag}-{tag}/lib/python{version}/site-packages/numpy/_core/include"

# Lets ament's index find the packages of this environment with nothing sourced; other prefixes stay first.
AMENT_INDEX_HOOK = (
    "import os, sys; p = [x for x in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if x]; "
    "os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join(p if sys.prefix in p else [*p, sys.prefix])\n"
)


class SetupError(Exception):
    """A step that cannot be done; the message says why and the way out."""


# --- what must be there before ---------------------------------------------------------------------------


def usable(version: tuple[int, ...]) -> bool:
    """Whether the ROS wheels exist for this (major, minor, …) Python version."""
    return OLDEST <= version[:2] < BEYOND_NEWEST


def other_interpreter() -> str | None:
    """Path of a usable Python on PATH, or None."""
    for name in ("python3.12", "python3.11"):
        path = shutil.which(name)
        if path and subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode == 0:
            return path
    return None


def ensure_python() -> None:
    """Continue in a usable Python, or raise SetupError."""
    if usable(sys.version_info[:2]):
        return
    found = "{}.{}".format(*sys.version_info[:2])
    other = other_interpreter()
    if other is None:
        raise SetupError(
            f"Python {found} is running, but the ROS 2 Jazzy wheels need Python 3.11 or 3.12.\n"
            "  Debian 12:     apt install python3 python3-venv python3-dev\n"
            "  Ubuntu 24.04:  apt install python3 python3-venv python3-dev\n"
            "  elsewhere:     install Python 3.12 and say  make setup PYTHON=/path/to/python3.12"
        )
    print(f"Python {found} is too old or too new; continuing with {other}", flush=True)
    os.execv(other, [other, *sys.argv])


def compiles(compiler: str | None, language: str, source: str) -> bool:
    """Whether the compiler accepts a source text (no file is written)."""
    if compiler is None:
        return False
    command = [compiler, "-fsyntax-only", "-x", language, f"-I{sysconfig.get_paths()['include']}", "-"]
    return subprocess.run(command, input=source.encode(), capture_output=True, check=False).returncode == 0


def missing_prerequisites() -> list[tuple[str, str]]:
    """What is missing on this machine, each with the Debian/Ubuntu package that brings it."""
    python = "python{}.{}".format(*sys.version_info[:2])
    c, cxx = (shutil.which(os.environ.get(v) or d) for v, d in (("CC", "cc"), ("CXX", "c++")))
    has_c = compiles(c, "c", "#include <stdio.h>\n")
    has_venv = importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")
    tests = [
        (has_venv, "Python's venv", f"{python}-venv"),
        (has_c, "a C compiler with its headers", "build-essential"),
        (compiles(cxx, "c++", "#include <vector>\n"), "a C++ compiler with its headers", "build-essential"),
        (not has_c or compiles(c, "c", "#include <Python.h>\n"), "Python's C headers", f"{python}-dev"),
        (shutil.which("make"), "make", "make"),
    ]
    return [(what, package) for found, what, package in tests if not found]


def check_machine() -> None:
    """Raise SetupError naming each missing thing with the package to install."""
    if sys.platform != "linux":
        raise SetupError(f"found {sys.platform}, but the ROS 2 Jazzy wheels are for Linux: use one")
    missing = missing_prerequisites()
    if missing:
        names = "\n".join(f"  missing: {what:<33} package: {package}" for what, package in missing)
        packages = " ".join(sorted({package for _, package in missing}))
        raise SetupError(f"this machine lacks what the set-up needs\n{names}\n  sudo apt install {packages}")


# --- running commands ------------------------------------------------------------------------------------


def terminate_group(process: subprocess.Popen[bytes]) -> None:
    """Stop a command and all it started: ask first, then kill."""
    for sign, patience in ((signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0)):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, sign)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)
            return


def last_line(log: Path, width: int) -> str:
    """The last non-empty line of a log, cut to a width."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - 2000))
        lines = [line.strip() for line in file.read().decode(errors="replace").splitlines() if line.strip()]
    return lines[-1][:width] if lines else ""


def run(command: list[str], log: Path, environment: dict[str, str], cwd: Path | None = None) -> None:
    """Run a command with its output in a log, showing that it lives; raise SetupError if it fails."""
    with log.open("ab") as output:
        output.write(f"$ {' '.join(command)}\n".encode())
        output.flush()
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            env=environment, cwd=cwd, start_new_session=True,
        )  # fmt: skip
        try:
            watch(process, log)
        except BaseException:
            terminate_group(process)
            raise
    if process.returncode != 0:
        tail = "\n".join("  | " + x for x in log.read_text(errors="replace").splitlines()[-40:])
        code = process.returncode
        raise SetupError(f"a command failed with code {code}; its log ends with\n{tail}\n  whole log: {log}")


def watch(process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait for a command; on a terminal show its last line, else give a sign of life every 30 s."""
    begin = time.monotonic()
    live = sys.stdout.isatty()
    next_sign = 0.5 if live else 30.0
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.2)
            break
        elapsed = time.monotonic() - begin
        if elapsed < next_sign:
            continue
        next_sign = elapsed + (0.5 if live else 30.0)
        text = f"    {elapsed:4.0f} s  {last_line(log, 80)}"
        print(f"\r\033[K{text}" if live else text, end="" if live else "\n", flush=True)
    if live:
        print("\r\033[K", end="", flush=True)


# --- the steps -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Environment:
    """The virtual environment that is being made.

    Attributes:
        path: its folder, absolute.
    """

    path: Path

    @property
    def python(self) -> str:
        """Its interpreter."""
        return str(self.path / "bin" / "python")

    @property
    def state(self) -> Path:
        """Folder of stamps, logs and build files."""
        return self.path / ".setup"

    @property
    def site_packages(self) -> Path:
        """Its folder of Python packages."""
        return self.path / "lib" / "python{}.{}".format(*sys.version_info[:2]) / "site-packages"

    def log(self, step: str) -> Path:
        """The log file of a step."""
        return self.state / "logs" / f"{step}.log"

    def variables(self) -> dict[str, str]:
        """The variables for its commands: the user's, without those of other workspaces."""
        kept = {k: v for k, v in os.environ.items() if k not in FOREIGN_VARIABLES}
        path = os.pathsep.join([str(self.path / "bin"), kept.get("PATH", os.defpath)])
        own = dict.fromkeys(("VIRTUAL_ENV", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"), str(self.path))
        quiet = {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_NO_INPUT": "1", "PYTHONNOUSERSITE": "1"}
        return {**kept, **own, **quiet, "PATH": path, "COLCON_HOME": str(self.state / "colcon")}

    def pip(self, step: str, *arguments: str) -> None:
        """Run its pip, logged under a step."""
        run([self.python, "-m", "pip", *arguments], self.log(step), self.variables())


def make_venv(env: Environment) -> None:
    """Create the environment anew; refuse to replace one that this file did not make."""
    if env.path.exists():
        if not env.state.is_dir() and any(env.path.iterdir()):
            raise SetupError(f"{env.path} was not made by this set-up: move it away, or say --venv OTHER")
        shutil.rmtree(env.path)
    (env.state / "logs").mkdir(parents=True)
    (env.path / "COLCON_IGNORE").touch()
    run([sys.executable, "-m", "venv", str(env.path)], env.log("venv"), env.variables())


def install_requirements(env: Environment) -> None:
    """Install the pinned requirements and repair the wheels' CMake files."""
    env.pip("requirements", "install", "-r", str(ROOT / "requirements.txt"))
    repair_cmake_paths(env)
    (env.site_packages / "mebo_grasp_ament_index.pth").write_text(AMENT_INDEX_HOOK)


def repair_cmake_paths(env: Environment) -> None:
    """Point the wheels' CMake targets to the include folders of this interpreter."""
    version = "{}.{}".format(*sys.version_info[:2])
    tag = "cp" + version.replace(".", "")
    command = [env.python, "-c", "import numpy; print(numpy.get_include())"]
    answer = subprocess.run(command, env=env.variables(), capture_output=True, text=True, check=True)
    new_texts = {
        WHEEL_PYTHON_INCLUDE.format(tag=tag, version=version): sysconfig.get_paths()["include"],
        WHEEL_NUMPY_INCLUDE.format(tag=tag, version=version): answer.stdout.strip(),
    }
    for file in env.path.glob("share/*/cmake/*.cmake"):
        text = repaired = file.read_text()
        for old, new in new_texts.items():
            repaired = repaired.replace(old, new)
        if repaired != text:
            file.write_text(repaired)


def install_test_tools(env: Environment) -> None:
    """Install what tests and linters need."""
    env.pip("test-tools", "install", "-r", str(ROOT / "requirements-dev.txt"))


def build_interfaces(env: Environment) -> None:
    """Build the typed interfaces into the environment, replacing an earlier build."""
    build = env.state / "build"
    remove_installed_files(build / INTERFACES / "install_manifest.txt")
    shutil.rmtree(build, ignore_errors=True)
    build.mkdir()
    command = [
        str(env.path / "bin" / "colcon"), "--log-base", str(env.state / "colcon-log"),
        "build", "--merge-install", "--install-base", str(env.path), "--build-base", str(build),
        "--base-paths", str(ROOT / INTERFACES), "--event-handlers", "console_direct+",
        "--cmake-args", f"-DPython3_EXECUTABLE={env.python}", "-DBUILD_TESTING=OFF",
    ]  # fmt: skip
    run(command, env.log("interfaces"), {"MAKEFLAGS": f"-j{os.cpu_count()}", **env.variables()}, cwd=build)


def remove_installed_files(manifest: Path) -> None:
    """Delete the files that an earlier CMake build installed, so that a removed message does not linger."""
    if manifest.is_file():
        for name in manifest.read_text().splitlines():
            Path(name).unlink(missing_ok=True)


def install_package(env: Environment) -> None:
    """Install this package in editable mode and import what a node needs."""
    env.pip("package", "install", "--no-deps", "--no-build-isolation", "--editable", str(ROOT))
    link_into_ament_index(env)
    modules = f"{PACKAGE}, msg_adapters, {INTERFACES}.msg, numba, pybullet, rclpy, scipy, sklearn, trimesh"
    run([env.python, "-c", f"import {modules}"], env.log("package"), env.variables(), cwd=env.state)


def compile_ahead(env: Environment) -> None:
    """Use the compiled parts once, so that their code is in the cache."""
    run([env.python, str(ROOT / "tools" / "warm_up.py")], env.log("compiled"), env.variables(), cwd=env.state)


def link_into_ament_index(env: Environment) -> None:
    """Show ament (get_package_share_directory, `ros2 run`) what an editable installation leaves out."""
    share, executables = env.path / "share", env.path / "lib" / PACKAGE
    links = {
        share / "ament_index" / "resource_index" / "packages" / PACKAGE: ROOT / "resource" / PACKAGE,
        share / PACKAGE / "package.xml": ROOT / "package.xml",
        share / PACKAGE / "params": ROOT / "params",
        **{executables / node: env.path / "bin" / node for node in NODES},
    }
    for link, target in links.items():
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(target)


def install_icub_meshes(env: Environment) -> None:
    """Install the iCub's meshes without the requirements of the package that holds them."""
    env.pip("icub-meshes", "install", "--no-deps", "-r", str(ROOT / "requirements-icub-meshes.txt"))


@dataclass(frozen=True)
class Step:
    """One step of the set-up.

    Attributes:
        name: of its stamp and log.
        does: what is printed while it runs.
        made_from: glob patterns, relative to the repository, of the files that decide whether it runs again.
        after: names of the steps whose change makes it run again too.
        action: what does it.
    """

    name: str
    does: str
    made_from: tuple[str, ...]
    after: tuple[str, ...]
    action: Callable[[Environment], None]


STEPS = (
    Step("venv", "creating the virtual environment", (), (), make_venv),
    Step("requirements", "installing requirements (about a minute, or more where pybullet is compiled)",
         ("requirements.txt",), ("venv",), install_requirements),
    Step("test-tools", "installing test tools", ("requirements-dev.txt",), ("venv",), install_test_tools),
    Step("interfaces", "building the typed interfaces (about half a minute)",
         (f"{INTERFACES}/**/*",), ("requirements",), build_interfaces),
    Step("package", "installing mebo_grasp",
         ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "resource/*"),
         ("requirements", "interfaces"), install_package),
    Step("compiled", "compiling what would otherwise be compiled at its first use (one to two minutes)",
         ("tools/warm_up.py", "mebo_grasp/compiling.py", "mebo_grasp/quality_diversity.py",
          "mebo_grasp/grasping/*.py", "mebo_grasp/solutions/*.py",
          "mebo_grasp/optimization/surrogate/*.py", "mebo_grasp/optimization/selection/*.py"),
         ("package",), compile_ahead),
)  # fmt: skip
ICUB_MESHES = Step(
    "icub-meshes", "installing the iCub's meshes",
    ("requirements-icub-meshes.txt",), ("venv",), install_icub_meshes,
)  # fmt: skip


def keys(steps: tuple[Step, ...], env: Environment) -> dict[str, str]:
    """For each step the hash of all that it is made from."""
    found: dict[str, str] = {}
    for step in steps:
        digest = hashlib.sha256()
        if step.action is make_venv:
            base = getattr(sys, "_base_executable", sys.executable)
            digest.update(f"{env.path} {sys.version_info[:2]} {Path(base).resolve()}".encode())
        for pattern in step.made_from:
            for file in sorted(p for p in ROOT.glob(pattern) if p.is_file()):
                digest.update(f"{file.relative_to(ROOT)} {file.stat().st_size} ".encode() + file.read_bytes())
        digest.update(" ".join(found[name] for name in step.after).encode())
        found[step.name] = digest.hexdigest()
    return found


def set_up(env: Environment, steps: tuple[Step, ...]) -> None:
    """Do the steps whose stamp is missing or out of date."""
    wanted = keys(steps, env)
    stamps = {step.name: env.state / f"{step.name}.stamp" for step in steps}
    due = [s for s in steps if not stamps[s.name].is_file() or stamps[s.name].read_text() != wanted[s.name]]
    if not due:
        print(f"environment is up to date: {env.path}")
        return
    check_machine()
    for number, step in enumerate(due, 1):
        print(f"[{number}/{len(due)}] {step.does}", flush=True)
        begin = time.monotonic()
        stamps[step.name].unlink(missing_ok=True)
        env.log(step.name).unlink(missing_ok=True)
        step.action(env)
        stamps[step.name].write_text(wanted[step.name])
        print(f"    done in {time.monotonic() - begin:.1f} s", flush=True)
    print(f"environment is ready: {env.path}")


@contextlib.contextmanager
def only_one_at_a_time() -> Iterator[None]:
    """Hold the repository's lock, waiting for a set-up that already runs."""
    handle = os.open(ROOT, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("another set-up is running here; waiting for it", flush=True)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def stop_on_termination(*_: object) -> None:
    """Treat a request to terminate as Ctrl-C."""
    raise KeyboardInterrupt


def main() -> int:
    """Run the set-up; the exit code is 0, 1 (failed) or 130 (interrupted)."""
    parser = argparse.ArgumentParser(description="Make or update the virtual environment of mebo_grasp.")
    parser.add_argument("--venv", type=Path, default=ROOT / ".venv", help="its folder (default: .venv here)")
    parser.add_argument("--icub-meshes", action="store_true", help="also install the iCub's meshes")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, stop_on_termination)
    try:
        ensure_python()
        env = Environment(Path(os.path.abspath(arguments.venv)))
        with only_one_at_a_time():
            set_up(env, (*STEPS, ICUB_MESHES) if arguments.icub_meshes else STEPS)
    except SetupError as error:
        print(f"set-up failed: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("\nset-up interrupted; run it again to continue", file=sys.stderr)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    sys.exit(main())
