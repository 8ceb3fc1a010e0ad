"""``mebo-grasp experiment NAME``: experiments from one command, built-in ones or a file of your own."""

from __future__ import annotations

import argparse
import shlex

from mebo_grasp.experiments import cec2013_command, study_command
from mebo_grasp.experiments.definition import builtin_names

CEC2013 = "cec2013"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.description = f"Experiments: {', '.join((CEC2013, *builtin_names()))}, or a YAML file (docs/experiments.md)."
    parser.epilog = "`mebo-grasp experiment NAME --help` tells the options of an experiment."
    parser.add_argument("name", metavar="NAME", help="name of an experiment, or a file")
    # Each kind of experiment has options of its own; they are read once the name is known.
    parser.add_argument("options", nargs=argparse.REMAINDER, metavar="...", help="its options")


def run(arguments: argparse.Namespace) -> int:
    """Read the options of the experiment and run it; returns the exit code."""
    parser = argparse.ArgumentParser(prog=f"mebo-grasp experiment {arguments.name}")
    if arguments.name == CEC2013:
        cec2013_command.add_arguments(parser)
        return cec2013_command.run(parser.parse_args(arguments.options))
    study_command.add_arguments(parser)
    command = shlex.join(["mebo-grasp", "experiment", arguments.name, *arguments.options])
    return study_command.run(arguments.name, parser.parse_args(arguments.options), command)
