"""``mebo-grasp explore``: one object, three nodes, a set of diverse grasps."""

from __future__ import annotations

import argparse
import fcntl
import math
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mebo_grasp.cli.exploration_summary import print_summary
from mebo_grasp.cli.explored_nodes import NODES, check_continues, node_parameters
from mebo_grasp.cli.report import ProgressLine
from mebo_grasp.cli.run_folder import DATABASE, PAGE, PICTURE, RUN_LOG
from mebo_grasp.cli.scene_options import add_scene_arguments, add_trial_arguments, trial_settings
from mebo_grasp.cli.search_box import add_space_arguments, describe, searched_space
from mebo_grasp.cli.stopping import stop_at_signals
from mebo_grasp.errors import InvalidSettingsError, MeboGraspError
from mebo_grasp.grasping.hand_model import ALL_HAND_NAMES, HandModel
from mebo_grasp.grasping.rendering import render_grasps
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, TargetObject
from mebo_grasp.nodes.domain import private_domain
from mebo_grasp.nodes.exploration_client import ExplorationClient, Standing
from mebo_grasp.nodes.processes import NodeGroup, NodeProcess
from mebo_grasp.optimization.methods.base import (
    KERNEL_NAMES,
    LEARNING_NAMES,
    SURROGATE_NAMES,
    WARP_NAMES,
    MethodSettings,
)
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES, check_method

START_TIMEOUT = 300.0
"""Seconds until the nodes must be up; a first start compiles, on a busy machine for minutes."""
STATUS_TIMEOUT = 10.0
"""Seconds that an exploration which is stopped while it starts waits for the optimizer's first word."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Explores an object with three ROS 2 nodes on this machine. An unfinished run in the output folder is "
        "resumed, and a finished one goes on with a higher --budget. Ctrl-C stops cleanly and keeps what was found."
    )
    add_scene_arguments(parser)
    add_trial_arguments(parser)
    parser.add_argument(
        "--method",
        default=DEFAULT_METHOD,
        help=f"one of {', '.join(METHOD_NAMES)} (default: {DEFAULT_METHOD})",
    )
    _add_surrogate_options(parser)
    _add_noise_options(parser)
    add_space_arguments(parser)
    parser.add_argument("--budget", type=int, default=250, help="number of trials (default: 250)")
    parser.add_argument("--initial", type=int, default=25, help="of these, initial design (default: 25)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random generator (default: 1)")
    parser.add_argument("--size", type=int, default=4, help="grasps in the solution set (default: 4)")
    parser.add_argument("--min-distance", type=float, default=0.04, help="least distance of two [m] (default: 0.04)")
    parser.add_argument("--out", type=Path, help="folder of the run (default: out/<object>-<time>)")
    parser.add_argument("--restart", action="store_true", help="begin anew if the folder holds a run")


def _add_surrogate_options(parser: argparse.ArgumentParser) -> None:
    """What a method's surrogate is; the default method chooses its own by evidence."""
    parser.add_argument(
        "--kernel", default=KERNEL_NAMES[0], choices=KERNEL_NAMES,
        help=f"covariance of a method other than {DEFAULT_METHOD} (default: {KERNEL_NAMES[0]})",
    )  # fmt: skip
    parser.add_argument(
        "--warp", default=WARP_NAMES[0], choices=WARP_NAMES,
        help=f"learned map of each input before the kernel (default: {WARP_NAMES[0]})",
    )  # fmt: skip
    parser.add_argument(
        "--learning", default=LEARNING_NAMES[0], choices=LEARNING_NAMES,
        help=f"how hyperparameters are learned (default: {LEARNING_NAMES[0]})",
    )  # fmt: skip
    parser.add_argument(
        "--surrogate", default=SURROGATE_NAMES[0], choices=SURROGATE_NAMES,
        help=f"one Gaussian process, or one a region (default: {SURROGATE_NAMES[0]})",
    )  # fmt: skip


def _add_noise_options(parser: argparse.ArgumentParser) -> None:
    """How far the robot may miss the pose that it is told."""
    parser.add_argument(
        "--safe", action="store_true", help="prefer grasps that are good although the pose is missed a little"
    )
    parser.add_argument(
        "--position-noise", type=float, default=0.0, help="standard deviation of the executed position [m]"
    )
    parser.add_argument(
        "--rotation-noise", type=float, default=0.0,
        help="the same of angles [rad] (default, with neither given: 3 %% of each side of the search box)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Explore, report and draw; returns the exit code."""
    target = TargetObject.load(options.object, options.scale, options.concave)
    hand = HandModel.load(options.hand)
    trial_settings(options)
    _check(options)
    space = searched_space(options, target, hand)
    options.object = name_from_anywhere(options.object, BUILTIN_OBJECTS)
    options.hand = name_from_anywhere(options.hand, ALL_HAND_NAMES)
    directory = _make_directory(options, target.object_id)
    with (
        stop_at_signals() as stop,
        sole_user(directory),
        private_domain() as domain_id,
        NodeGroup() as nodes,
        ExplorationClient(domain_id, target.object_id) as client,
    ):
        if options.restart:
            _delete_run(directory)
        parameters = node_parameters(options, directory, space)
        raised_from = check_continues(directory, parameters)
        print(f"exploring '{target.object_id}' (ROS_DOMAIN_ID={domain_id}, this machine only)")
        print(f"search space {options.space}: {describe(space)}")
        print(f"the run is kept in {directory}")
        if raised_from is not None:
            print(f"its budget is raised from {raised_from} to {options.budget} trials")
        for name, values in parameters.items():
            nodes.start(NodeProcess(name, values, directory, domain_id))
        interrupted = not _follow(nodes, client, stop)
        grasps = print_summary(client, target, options.size, options.min_distance)
    if grasps:
        picture = directory / PICTURE
        render_grasps(target, hand, [stamped.grasp for stamped in grasps], picture)
        print(f"\npicture: {picture}")
    return 130 if interrupted else 0


def name_from_anywhere(name: str, built_in: Sequence[str]) -> str:
    """Return a built-in name as it is, and of a file the whole path: the nodes and a later `show` may run elsewhere."""
    return str(Path(name).resolve()) if name not in built_in and Path(name).is_file() else name


def _check(options: argparse.Namespace) -> None:
    """Refuse what the nodes would refuse, before they are started and a folder is made."""
    for name, least in (("budget", 1), ("initial", 1), ("seed", 0), ("size", 1), ("min_distance", 0.0)):
        value = getattr(options, name)
        if not (value >= least and math.isfinite(value)):
            option = name.replace("_", "-")
            raise InvalidSettingsError(f"--{option} must be a finite number of at least {least}, got {value}")
    if options.method not in METHOD_NAMES:
        raise InvalidSettingsError(f"--method is '{options.method}', known are {', '.join(METHOD_NAMES)}")
    chosen = MethodSettings(
        kernel=options.kernel, warp=options.warp, learning=options.learning, surrogate=options.surrogate,
        safe=options.safe,
    )  # fmt: skip
    check_method(options.method, chosen)
    for name in ("position_noise", "rotation_noise"):
        if not 0.0 <= getattr(options, name) < float("inf"):
            flag = name.replace("_", "-")
            raise InvalidSettingsError(f"--{flag} must be finite and at least 0, got {getattr(options, name)}")


def _make_directory(options: argparse.Namespace, object_id: str) -> Path:
    directory: Path = options.out or Path("out") / f"{object_id}-{time.strftime('%Y%m%d-%H%M%S')}"
    if directory.exists() and not directory.is_dir():
        raise InvalidSettingsError(f"--out {directory} is a file; name a folder")
    directory.mkdir(parents=True, exist_ok=True)
    return directory


def _delete_run(directory: Path) -> None:
    names = [DATABASE, f"{DATABASE}-wal", f"{DATABASE}-shm", RUN_LOG, PICTURE, PAGE]
    for name in (*names, *(f"{node}.log" for node in NODES)):
        (directory / name).unlink(missing_ok=True)


@contextmanager
def sole_user(directory: Path) -> Iterator[None]:
    """Keep a second exploration out of a folder; the kernel ends this with the process, however that ends.

    Raises:
        InvalidSettingsError: an exploration runs there.
    """
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InvalidSettingsError(
                f"another exploration runs in {directory}: stop it, or name another folder by --out"
            ) from error
        yield
    finally:
        os.close(descriptor)


def _follow(nodes: NodeGroup, client: ExplorationClient, stop: threading.Event) -> bool:
    """Show progress until the budget is spent; False when the user stopped it."""
    line = ProgressLine()
    end = time.monotonic() + START_TIMEOUT
    while not stop.is_set() and (client.standing is None or not client.services_ready()):
        nodes.check()
        if time.monotonic() > end:
            raise MeboGraspError(f"the nodes did not start within {START_TIMEOUT:.0f} s; see their logs")
        client.spin(0.1)
    while not stop.is_set() and client.standing is not None and not client.standing.finished:
        nodes.check()
        _show(line, client.standing)
        if not client.standing.exploring and client.standing.note:
            line.end()
            raise MeboGraspError(f"the optimizer {client.standing.note}; what was found is kept")
        client.spin(0.1)
    if client.standing is not None:
        _show(line, client.standing)
    line.end()
    if stop.is_set():
        print("stopping; what was found is kept")
        _pause(nodes, client)
    return not stop.is_set()


def _pause(nodes: NodeGroup, client: ExplorationClient) -> None:
    """Let no trial be under way; an optimizer that says nothing is not up yet and has asked for none."""
    end = time.monotonic() + STATUS_TIMEOUT
    while client.standing is None and time.monotonic() < end:
        nodes.check()
        client.spin(0.1)
    if client.standing is not None and client.standing.exploring:
        client.pause()


def _show(line: ProgressLine, now: Standing) -> None:
    line.show(now.evaluations, now.budget, now.best_quality, now.seconds_per_trial, now.note)
