"""The ``mebo-grasp`` command: explores an object, shows what was found, runs experiments.

Exit codes: 0 done, 1 something failed, 2 the command line or a setting is wrong, 3 no grasp is left (``best``),
130 stopped by Ctrl-C, 141 whoever read the output has gone (``| head``).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from mebo_grasp import __version__
from mebo_grasp.cli import best, doctor, exchange, experiment, explore, show, trial
from mebo_grasp.errors import MeboGraspError

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

COMMANDS = (explore, show, best, trial, doctor, exchange, experiment)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="mebo-grasp",
        description="Explores grasps of an object by multisolution Bayesian optimization.",
    )
    parser.add_argument("--version", action="version", version=f"mebo_grasp {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in COMMANDS:
        module.add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    options = make_parser().parse_args(arguments)
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
        if error.filename is None:
            raise
        print(
            f"mebo-grasp {options.command}: cannot use '{error.filename}': {error.strerror}; name another place",
            file=sys.stderr,
        )
        return EXIT_FAILED
    return code


if __name__ == "__main__":
    sys.exit(main())
