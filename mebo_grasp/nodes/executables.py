"""What ``ros2 run`` starts: a node is imported here, so that a Ctrl-C in the seconds this takes ends it quietly."""

from contextlib import suppress
from importlib import import_module


def _run(node: str) -> None:
    # It comes from the imports: a node that runs has a handler of its own.
    with suppress(KeyboardInterrupt):
        import_module(f"mebo_grasp.nodes.{node}").main()


def optimizer_node() -> None:
    """Run the optimizer node until it is stopped."""
    _run("optimizer_node")


def hand_node() -> None:
    """Run the hand node until it is stopped."""
    _run("hand_node")


def solution_set_node() -> None:
    """Run the solution set node until it is stopped."""
    _run("solution_set_node")
