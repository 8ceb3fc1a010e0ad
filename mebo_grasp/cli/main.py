"""The ``mebo-grasp`` command: explores an object, shows what was found, runs experiments.

Exit codes: 0 done, 1 something failed, 2 the command line or a setting is wrong, 3 no grasp is left (``best``),
130 stopped by Ctrl-C, 141 whoever read the output has gone (``| head``).
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module

from mebo_grasp import __version__
from mebo_grasp.errors import MeboGraspError, os_error_text

NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
"""What is a value and no option: argparse before Python 3.14 knows no exponents, as of ``--pose 0 0.05 -1e-3 ...``."""

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

COMMANDS = {
    "explore": ("explore", "explore an object with three nodes over ROS 2 and print its diverse grasps"),
    "show": ("show", "print and draw the diverse grasps of a stored run"),
    "best": ("best", "print the best grasps of a stored run that nothing blocks"),
    "trial": ("trial", "try one pose, print all that came of it and draw it"),
    "doctor": ("doctor", "check a hand and an object before a run"),
    "export": ("export_trials", "write the trials of a stored run as CSV, JSON lines or MCAP"),
    "import": ("import_trials", "store the trials of a CSV, JSON lines or MCAP file"),
    "experiment": ("experiment", "run an experiment; write tables, plots and a report"),
}
"""Module of each command in this folder, and what the command does."""


def make_parser(chosen: str | None) -> argparse.ArgumentParser:
    """Return the parser of the command line.

    Args:
        chosen: the command whose options are needed. The others are only named: to import everything that all of
            them need takes seconds.
    """
    parser = argparse.ArgumentParser(
        prog="mebo-grasp",
        description="Explores grasps of an object by multisolution Bayesian optimization.",
    )
    parser.add_argument("--version", action="version", version=f"mebo_grasp {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, purpose) in COMMANDS.items():
        command_parser = commands.add_parser(name, help=purpose)
        command_parser._negative_number_matcher = NEGATIVE_NUMBER
        if name == chosen:
            command = import_module(f"mebo_grasp.cli.{module}")
            command.add_arguments(command_parser)
            command_parser.set_defaults(run=command.run)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    chosen = next((argument for argument in given if not argument.startswith("-")), None)
    parser = make_parser(chosen)
    if not given:
        parser.print_help(sys.stderr)
        return EXIT_USAGE
    options = parser.parse_args(given)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # What is still buffered goes nowhere: Python would complain once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except MeboGraspError as error:
        print(f"mebo-grasp {options.command}: {error}", file=sys.stderr)
        return EXIT_USAGE if isinstance(error, ValueError) else EXIT_FAILED
    except OSError as error:
        print(f"mebo-grasp {options.command}: {os_error_text(error)}", file=sys.stderr)
        return EXIT_FAILED
    return code


if __name__ == "__main__":
    sys.exit(main())
