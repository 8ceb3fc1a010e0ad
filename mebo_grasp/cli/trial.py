"""``mebo-grasp trial``: one trial, printed in full and drawn."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mebo_grasp.cli.first_use import explained
from mebo_grasp.cli.report import require_png
from mebo_grasp.cli.scene_options import add_scene_arguments, add_trial_arguments, trial_settings
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.rendering import render_trial
from mebo_grasp.grasping.robustness import ExecutionNoise, execute_repeatedly
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

NOISES = {"position": "m", "rotation": "rad", "friction": "1", "normal": "rad"}
"""What may be off when a trial is repeated, and the unit of its standard deviation."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Places the hand, closes it and measures the grasp. The pose is that of the TCP in the "
        "object's frame: x y z in metres, then either roll pitch yaw in radians or a quaternion qx qy qz qw."
    )
    add_scene_arguments(parser)
    parser.add_argument(
        "--pose", nargs="+", metavar="NUMBER", help="default: the middle of the object's position space"
    )
    add_trial_arguments(parser)
    parser.add_argument("--repeat", type=int, default=0, help="also execute it so many times with noise")
    for name, unit in NOISES.items():
        parser.add_argument(
            f"--{name}-noise", type=float, default=0.0, help=f"standard deviation for --repeat [{unit}]"
        )
    parser.add_argument("--seed", type=int, default=1, help="seed of the noise (default: 1)")
    parser.add_argument("--out", type=Path, help="PNG file to draw the trial into")


def run(options: argparse.Namespace) -> int:
    """Execute, print and draw; returns the exit code."""
    require_png("--out", options.out)
    noise = execution_noise(options)
    settings = trial_settings(options)
    target = TargetObject.load(options.object, options.scale, options.concave)
    hand = HandModel.load(options.hand)
    pose = middle_pose(target, hand) if options.pose is None else parse_pose(" ".join(options.pose))
    with explained():
        simulator = GraspSimulator(target, hand, settings)
        simulator.trial(pose)  # The first one loads compiled code, which is not what a trial takes.
    with simulator:
        grasp = simulator.trial(pose)
        further = simulator.further_metrics(grasp)
        print(trial_text(grasp, settings, further))
        if options.repeat:
            print(f"\n{repeated_text(simulator, pose, noise, options)}")
    if options.out is not None:
        render_trial(target, hand, grasp, options.out)
        print(f"\npicture: {options.out}")
    return 0


def execution_noise(options: argparse.Namespace) -> ExecutionNoise:
    """Return the noise that the options describe.

    Raises:
        InvalidSettingsError: a number is out of its range, or there is noise without ``--repeat`` or the reverse.
    """
    if options.repeat < 0:
        raise InvalidSettingsError(f"--repeat is {options.repeat}; it must be at least 1, or 0 for none")
    if options.seed < 0:
        raise InvalidSettingsError(f"--seed is {options.seed}; it must be at least 0")
    noise = ExecutionNoise(**{kind: getattr(options, f"{kind}_noise") for kind in NOISES})
    flags = ", ".join(f"--{kind}-noise" for kind in NOISES)
    if options.repeat and noise == ExecutionNoise():
        raise InvalidSettingsError(
            f"--repeat {options.repeat} without noise would give the same grasp each time; give any of {flags}"
        )
    if noise != ExecutionNoise() and not options.repeat:
        raise InvalidSettingsError(f"{flags} count for --repeat alone; give --repeat 100, say")
    return noise


def repeated_text(simulator: GraspSimulator, pose: Pose, noise: ExecutionNoise, options: argparse.Namespace) -> str:
    """Execute a pose with noise as often as the options say and return what came of it."""
    found = execute_repeatedly(simulator, pose, noise, options.repeat, np.random.default_rng(options.seed))
    ends = ", ".join(f"{count} {outcome.name}" for outcome, count in found.outcomes.most_common())
    known = found.under_noise
    figures = (
        "no quality: all executions failed"
        if known is None
        else f"quality mean {known.expected:.6g}, standard deviation {known.sd:.6g}, worst {known.worst:.6g}"
    )
    return f"executed {options.repeat} times with noise (seed {options.seed}): {ends}\n  {figures}"


def middle_pose(target: TargetObject, hand: HandModel) -> Pose:
    """Return the middle of the position space."""
    space = position_space(target, hand)
    return space.to_pose((space.lower + space.upper) / 2.0)


def parse_pose(text: str) -> Pose:
    """Read x y z roll pitch yaw, or x y z qx qy qz qw; blanks or commas between them.

    Raises:
        InvalidSettingsError: not six or seven numbers.
        InvalidPoseError: numbers that are not finite, or a quaternion that is not of unit length.
    """
    words = text.replace(",", " ").split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise InvalidSettingsError(f"--pose '{text}' holds something that is no number: {error}") from error
    if len(values) == 6:
        return Pose.from_rpy(values[:3], values[3:])
    if len(values) == 7:
        return Pose(values[:3], values[3:])
    raise InvalidSettingsError(
        f"--pose has {len(values)} numbers; give 6 (x y z roll pitch yaw) or 7 (x y z qx qy qz qw), m and rad"
    )


def trial_text(grasp: Grasp, settings: TrialSettings, further: Mapping[str, float]) -> str:
    """Return everything a trial yielded, for a person to read; ``further`` has the metrics that a grasp has not."""
    pose = grasp.T_object_tcp
    lines = [
        f"object   {grasp.object_id}",
        f"hand     {grasp.hand}, engine {settings.engine}",
        f"pose     xyz {_numbers(1000 * pose.position, 2)} mm, rpy {_numbers(np.degrees(pose.rpy), 2)} deg",
        f"         quaternion xyzw {_numbers(pose.quaternion_xyzw, 6)}",
        f"outcome  {grasp.outcome.name}, {len(grasp.contacts)} contacts, {1e3 * grasp.computation_time:.2f} ms",
        "",
        f"quality  {grasp.quality:.6g} ({settings.quality})",
    ]
    lines += [f"  {name:<22} {value}" for name, value in metric_lines(grasp, further)]
    if grasp.message:
        lines.append(f"  note: {grasp.message}")
    lines += ["", "contacts (object frame)", *_contact_lines(grasp), "", "joints [deg]", *_joint_lines(grasp)]
    return "\n".join(lines)


def metric_lines(grasp: Grasp, further: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return name and value of each metric of a grasp."""
    return [
        ("epsilon", f"{grasp.epsilon:.6g}"),
        ("volume", f"{grasp.volume:.6g}"),
        ("isotropy", f"{grasp.isotropy:.6g}"),
        ("force closure", "yes" if grasp.force_closure else "no"),
        *((name, f"{value:.6g}") for name, value in further.items()),
    ]


def _contact_lines(grasp: Grasp) -> list[str]:
    if not grasp.contacts:
        return ["  none"]
    width = max(len(contact.link) for contact in grasp.contacts)
    return [
        f"  {contact.link:<{width}}  point {_numbers(1000 * contact.position, 2)} mm"
        f"  normal {_numbers(contact.normal, 4)}"
        for contact in grasp.contacts
    ]


def _joint_lines(grasp: Grasp) -> list[str]:
    posture = grasp.hand_posture
    width = max((len(name) for name in posture.names), default=0)
    return [
        f"  {name:<{width}}  {np.degrees(value):7.2f}"
        for name, value in zip(posture.names, posture.positions, strict=True)
    ]


def _numbers(values: np.ndarray, digits: int) -> str:
    return "(" + ", ".join(f"{value + 0.0:.{digits}f}" for value in values) + ")"
