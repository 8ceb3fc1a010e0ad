"""``mebo-grasp doctor``: checks a hand and an object before a run."""

from __future__ import annotations

import argparse

from mebo_grasp.cli.first_use import explained
from mebo_grasp.cli.scene_options import add_scene_arguments
from mebo_grasp.errors import InvalidHandError, InvalidObjectError
from mebo_grasp.grasping.doctor import Finding, Level, check_hand, check_object, check_together
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import ConcaveShape, TargetObject

MARKS = {Level.OK: "ok     ", Level.WARNING: "warning", Level.ERROR: "ERROR  "}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = (
        "Says which hand is in use and checks hand and object: units and scale, watertightness, "
        "frames, self-collision in the preshape, closing that touches nothing. Exit code 1 if an error was found."
    )
    add_scene_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Print what was found; returns the exit code."""
    with explained():
        findings = examine(options.hand, options.object, options.scale, options.concave)
    for finding in findings:
        print(f"{MARKS[finding.level]}  {finding.topic}: {finding.text}")
    worst = [sum(finding.level is level for finding in findings) for level in (Level.ERROR, Level.WARNING)]
    print(f"{worst[0]} errors, {worst[1]} warnings")
    return 1 if worst[0] else 0


def examine(hand_name: str, object_name: str, scale: float, concave: ConcaveShape = "surface") -> list[Finding]:
    """Check hand, object and both together as far as each can be loaded."""
    findings: list[Finding] = []
    hand = target = None
    try:
        hand = HandModel.load(hand_name)
        findings += check_hand(hand)
    except InvalidHandError as error:
        findings.append(Finding(Level.ERROR, "hand", str(error)))
    try:
        target = TargetObject.load(object_name, scale, concave)
        findings += check_object(target)
    except InvalidObjectError as error:
        findings.append(Finding(Level.ERROR, "object", str(error)))
    sound = all(finding.level is not Level.ERROR for finding in findings)
    if hand is not None and target is not None and sound:
        findings += check_together(hand, target)
    return findings
