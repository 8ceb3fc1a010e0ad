"""``mebo-grasp experiment NAME``: benchmarks from one command."""

from __future__ import annotations

import argparse

from mebo_grasp.experiments import cec2013_command

EXPERIMENTS = {"cec2013": cec2013_command}


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser("experiment", help="run a benchmark and print its tables")
    names = parser.add_subparsers(dest="experiment", required=True, metavar="NAME")
    for name, module in EXPERIMENTS.items():
        own = names.add_parser(name, help=(module.__doc__ or "").splitlines()[0])
        module.add_arguments(own)
        own.set_defaults(run=module.run)
