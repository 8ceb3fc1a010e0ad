"""The rooms of docs/architecture.md and the arrows between them, by syntax tree and at run time."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("mebo_grasp", "msg_adapters")

GROUND = (
    "mebo_grasp.grasp", "mebo_grasp.errors", "mebo_grasp.compiled_code", "mebo_grasp.compiling",
    "mebo_grasp.quality_diversity",
)  # fmt: skip
OPTIMIZATION = "mebo_grasp.optimization"
LEAVES = tuple(f"{OPTIMIZATION}.{name}" for name in ("search_space", "initial_design", "observations", "blas_threads"))
INPUT_NOISE = f"{OPTIMIZATION}.input_noise"

# Libraries that only some rooms may touch, by the first part of the imported name.
ROS_CLIENT = re.compile(r"rclpy|rcl_.*|rcutils|rpyutils|rmw_.*|ament_(?!index_python).*|launch|launch_.*|tf2_.*")
MESSAGES = re.compile(r".*_msgs|builtin_interfaces|.*_interfaces|std_srvs")
# Tells where a package's interface files lie; no client library.
AMENT_INDEX = re.compile(r"ament_index_python.*")
BULLET = re.compile(r"pybullet.*")


@dataclass(frozen=True)
class Room:
    """A module or folder, and what its files may import of this repository besides the room itself.

    Attributes:
        name: dotted prefix; the longest that fits a module is its room.
        may_import: dotted prefixes.
        libraries: the restricted libraries it may use.
        closed: the name stands for the folder's front (`__init__`) alone; its files need rooms of their own.
    """

    name: str
    may_import: tuple[str, ...]
    libraries: tuple[re.Pattern[str], ...] = ()
    closed: bool = False


def _layers(folder: str, below: tuple[str, ...], names: tuple[str, ...]) -> tuple[Room, ...]:
    """Within a folder: each layer sees those before it, never back."""
    rooms = []
    for name in names:
        rooms.append(Room(f"{folder}.{name}", below))
        below = (*below, rooms[-1].name)
    return tuple(rooms)


THREE_ROOMS = (OPTIMIZATION, "mebo_grasp.grasping", "mebo_grasp.solutions")
BETWEEN_ROOMS = ("mebo_grasp.hand_volumes", "mebo_grasp.grasp_page")
BELOW_EXPERIMENTS = (*GROUND, *THREE_ROOMS, *BETWEEN_ROOMS)
EXPERIMENTS = "mebo_grasp.experiments"
BELOW_NODES = (*BELOW_EXPERIMENTS, EXPERIMENTS, "mebo_grasp.benchmarks", "msg_adapters")
# Value types of the solutions room that have a message.
SOLUTION_VALUES = (
    "mebo_grasp.solutions.frames",
    "mebo_grasp.solutions.occlusion",
    "mebo_grasp.solutions.solution_set",
)

ROOMS = (
    Room("mebo_grasp", ("mebo_grasp.compiled_code",), closed=True),
    Room("mebo_grasp.compiled_code", ()),
    Room("mebo_grasp.compiling", ()),
    Room("mebo_grasp.errors", ()),
    Room("mebo_grasp.grasp", ("mebo_grasp.errors",)),
    Room("mebo_grasp.quality_diversity", ("mebo_grasp.compiling", "mebo_grasp.grasp")),
    Room(OPTIMIZATION, GROUND, closed=True),
    *(Room(leaf, GROUND) for leaf in LEAVES),
    Room(INPUT_NOISE, (*GROUND, f"{OPTIMIZATION}.search_space")),
    *_layers(
        OPTIMIZATION,
        (*GROUND, *LEAVES, INPUT_NOISE),
        ("surrogate", "acquisition", "selection", "methods", "optimizer", "run_log", "logged_optimizer"),
    ),
    Room("mebo_grasp.grasping", GROUND, (BULLET,)),
    Room("mebo_grasp.solutions", GROUND),
    Room("msg_adapters", (*GROUND, *SOLUTION_VALUES), (MESSAGES, AMENT_INDEX)),
    # What the simulator knows of a hand, in the terms of the solution set.
    Room("mebo_grasp.hand_volumes", (*GROUND, "mebo_grasp.grasping", "mebo_grasp.solutions")),
    # Its looks, for the pages that show a set.
    Room("mebo_grasp.grasp_page", (*GROUND, "mebo_grasp.grasping", "mebo_grasp.solutions")),
    # Its files that no layer names are the commands: they see all layers.
    Room(EXPERIMENTS, BELOW_EXPERIMENTS),
    *_layers(
        EXPERIMENTS,
        BELOW_EXPERIMENTS,
        ("published", "problems", "objective", "objectives", "runs", "scores", "definition", "reports"),
    ),
    Room("mebo_grasp.benchmarks", (*BELOW_EXPERIMENTS, EXPERIMENTS)),
    Room("mebo_grasp.nodes", BELOW_NODES, (ROS_CLIENT, MESSAGES, AMENT_INDEX)),
    Room("mebo_grasp.cli", ("mebo_grasp.__version__", "mebo_grasp.nodes", *BELOW_NODES)),
)


def is_within(name: str, prefix: str) -> bool:
    return name == prefix or name.startswith(prefix + ".")


def room_of(module: str) -> Room | None:
    """The room with the longest fitting prefix; None for a file that a closed room does not name."""
    fitting = [room for room in ROOMS if is_within(module, room.name)]
    room = max(fitting, key=lambda r: len(r.name), default=None)
    return None if room is not None and room.closed and module != room.name else room


def imported_names(source: str, module: str, *, is_package: bool) -> list[str]:
    """Full dotted names of all imports at any depth: relative ones resolved, import_module("…") included."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = _base(node, module, is_package)
            names += [f"{base}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Call) and _is_import_call(node.func):
            constants = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
            names += [value for value in constants if isinstance(value, str)]
    return names


def _base(node: ast.ImportFrom, module: str, is_package: bool) -> str:
    """The absolute module that a from-import names."""
    if node.level == 0:
        return node.module or ""
    parts = module.split(".")
    kept = parts[: len(parts) - node.level + (1 if is_package else 0)]
    return ".".join([*kept, *([node.module] if node.module else [])])


def _is_import_call(function: ast.expr) -> bool:
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    return name in ("import_module", "__import__")


def violations(source: str, module: str, *, is_package: bool = False) -> list[str]:
    """Every import of a module's source that breaks a rule, as a sentence."""
    room = room_of(module)
    if room is None:
        return [f"{module} belongs to no room: give it a place in ROOMS"]
    found = []
    for name in imported_names(source, module, is_package=is_package):
        first = name.split(".")[0]
        restricted = [kind for kind in (ROS_CLIENT, MESSAGES, AMENT_INDEX, BULLET) if kind.fullmatch(first)]
        if first in PACKAGES:
            own = () if room.closed else (room.name,)
            if not any(is_within(name, prefix) for prefix in (*room.may_import, *own)):
                found.append(f"{module} ({room.name}) must not import {name}")
        elif any(kind not in room.libraries for kind in restricted):
            found.append(f"{module} ({room.name}) must not import the library {name}")
    return found


def sources() -> dict[str, Path]:
    """Every module of the packages, by dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def test_every_import_keeps_to_its_room() -> None:
    modules = sources()
    assert len(modules) > 30, "the walk found too few files to mean anything"
    broken = [
        line
        for module, path in modules.items()
        for line in violations(path.read_text(), module, is_package=path.name == "__init__.py")
    ]
    assert not broken, "\n".join(broken)


def test_every_room_of_the_table_exists() -> None:
    modules = sources()
    assert [room.name for room in ROOMS if room.name not in modules] == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("mebo_grasp.optimization.methods.new", "import rclpy"),
        ("mebo_grasp.optimization.methods.new", "from rclpy.node import Node"),
        ("mebo_grasp.grasping.trial", "def f():\n    from geometry_msgs.msg import Pose"),
        ("mebo_grasp.solutions.archive", "import mebo_grasp_interfaces.msg as m"),
        ("mebo_grasp.solutions.archive", "if TYPE_CHECKING:\n    from std_srvs.srv import Trigger"),
        ("mebo_grasp.cli.explore", "import rclpy"),
        ("mebo_grasp.cli.explore", "from mebo_grasp_interfaces.msg import GraspQuality"),
        ("msg_adapters.pose", "import rclpy.time"),
        ("mebo_grasp.nodes.hand_node", "import pybullet as p"),
        ("mebo_grasp.experiments.reports.cec2013_tables", "import pybullet_data"),
        ("mebo_grasp.optimization.search_space", "importlib.import_module('pybullet')"),
        ("mebo_grasp.optimization.methods.new", "from mebo_grasp.solutions.diversity import select"),
        ("mebo_grasp.optimization.methods.new", "from mebo_grasp import grasping"),
        ("mebo_grasp.optimization.methods.new", "import mebo_grasp.grasping.trial"),
        ("mebo_grasp.grasping.trial", "from mebo_grasp.optimization.search_space import SearchSpace"),
        ("mebo_grasp.solutions.archive", "from ..grasping import hand_model"),
        ("mebo_grasp.solutions.archive", "from mebo_grasp.nodes import qos"),
        ("mebo_grasp.experiments.runs.runner", "from mebo_grasp.nodes import qos"),
        ("mebo_grasp.experiments.runs.runner", "import msg_adapters.pose"),
        ("mebo_grasp.nodes.hand_node", "from mebo_grasp.cli import main"),
        ("msg_adapters.grasp", "from mebo_grasp.grasping.trial import Trial"),
        ("msg_adapters.grasp", "from mebo_grasp.solutions.archive import SolutionArchive"),
        ("mebo_grasp.grasp", "from mebo_grasp.solutions.occlusion import Box"),
        ("mebo_grasp.errors", "from mebo_grasp.grasp import Pose"),
        ("mebo_grasp.optimization.surrogate.kernels", "from mebo_grasp.optimization.acquisition import base"),
        ("mebo_grasp.optimization.surrogate.kernels", "from ..methods.base import Method"),
        ("mebo_grasp.optimization.acquisition.base", "from ..selection.boltzmann import draw"),
        ("mebo_grasp.optimization.selection.boltzmann", "import mebo_grasp.optimization.methods.mebo"),
        ("mebo_grasp.optimization.methods.mebo", "from mebo_grasp.optimization.optimizer import Optimizer"),
        ("mebo_grasp.optimization.methods.mebo", "from mebo_grasp.optimization import Optimizer"),
        ("mebo_grasp.optimization.search_space", "from .surrogate import kernels"),
        ("mebo_grasp.optimization.optimizer", "from mebo_grasp.optimization.run_log import RunLog"),
        ("mebo_grasp.optimization.unheard_of", ""),
        ("mebo_grasp.unheard_of", ""),
    ],
)
def test_the_checker_finds_a_broken_rule(module: str, source: str) -> None:
    assert len(violations(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("mebo_grasp.optimization.methods.new", "import numpy\nfrom ..surrogate import kernels"),
        ("mebo_grasp.optimization.methods.new", "from mebo_grasp import errors, grasp"),
        ("mebo_grasp.optimization.optimizer", "from mebo_grasp.optimization.methods.base import Method"),
        ("mebo_grasp.grasping.world", "import pybullet, pybullet_data"),
        ("msg_adapters.new", "from shape_msgs.msg import SolidPrimitive"),
        ("msg_adapters.new", "from mebo_grasp.solutions.occlusion import Box\nfrom . import pose"),
        ("mebo_grasp.nodes.new", "import rclpy\nfrom std_msgs.msg import String\nfrom . import qos"),
        ("mebo_grasp.nodes.new", "import msg_adapters.pose\nimport mebo_grasp.grasping.trial"),
        ("mebo_grasp.cli.new", "from mebo_grasp.nodes import qos"),
        ("mebo_grasp.cli.new", "from mebo_grasp.solutions.archive import SolutionArchive"),
        ("mebo_grasp.solutions.archive", "# import rclpy\ntext = 'import pybullet'"),
    ],
)
def test_the_checker_lets_a_kept_rule_pass(module: str, source: str) -> None:
    assert violations(source, module) == []


def test_relative_imports_of_a_package_front_start_in_the_package() -> None:
    source = "from .surrogate import kernels\nfrom . import run_log\nfrom .. import grasping"
    names = imported_names(source, "mebo_grasp.optimization", is_package=True)
    assert names == [f"{OPTIMIZATION}.surrogate.kernels", f"{OPTIMIZATION}.run_log", "mebo_grasp.grasping"]


@pytest.mark.parametrize(
    ("room", "forbidden"),
    [
        (OPTIMIZATION, ("rclpy", "geometry_msgs", "pybullet", "mebo_grasp.grasping", "mebo_grasp.solutions")),
        ("mebo_grasp.solutions", ("rclpy", "geometry_msgs", "pybullet", "mebo_grasp.grasping", OPTIMIZATION)),
        ("mebo_grasp.grasping", ("rclpy", "geometry_msgs", "mebo_grasp.solutions", OPTIMIZATION)),
    ],
)
def test_a_room_loads_alone(room: str, forbidden: tuple[str, ...]) -> None:
    """What the syntax tree cannot see: after importing a whole room, nothing of the forbidden is loaded."""
    modules = [name for name in sources() if is_within(name, room)]
    script = (
        "import importlib, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        f"print(*[name for name in {forbidden!r} if name in sys.modules], sep='\\n', end='')\n"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    loaded = [line for line in done.stdout.splitlines() if line in forbidden]
    assert loaded == []
