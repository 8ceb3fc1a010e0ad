"""What every node does before it spins, and with whom it ends."""

import gc
import subprocess
import sys
import textwrap
from collections.abc import Iterator

import pytest

from mebo_grasp.nodes.runtime import forget_garbage

NODE = """
import time
from mebo_grasp.nodes.runtime import end_with_parent
end_with_parent()
print("up", flush=True)
time.sleep(60)
"""
PARENT = f"""
import os, subprocess, sys, time
subprocess.Popen([sys.executable, "-c", {NODE!r}], env=os.environ | {{"MEBO_GRASP_PARENT": str(os.getpid())}})
time.sleep(60)
"""


@pytest.fixture
def thawed() -> Iterator[None]:
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("thawed")
def test_later_collections_leave_out_what_is_there_now() -> None:
    kept = [[k] for k in range(1000)]
    forget_garbage()
    assert gc.get_freeze_count() > len(kept)
    assert not any(item is kept for item in gc.get_objects())
    later: list[object] = []
    assert any(item is later for item in gc.get_objects())


def test_a_node_ends_when_its_exploration_is_killed() -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == "up\n"
    parent.kill()
    # The pipe is closed when the last process that writes to it has ended: the node, which would sleep on.
    rest, _ = parent.communicate(timeout=30)
    assert rest == ""


def test_a_signal_that_came_before_such_a_step_keeps_it_from_beginning() -> None:
    code = """
    import os, signal
    from mebo_grasp.nodes.runtime import StopSignal, may_be_broken_off
    signal.signal(signal.SIGTERM, StopSignal())
    os.kill(os.getpid(), signal.SIGTERM)
    print("before", flush=True)
    with may_be_broken_off():
        print("minutes of compiling")
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True)
    assert done.stdout == "before\n"


BUSY = """
import signal, time
from mebo_grasp.nodes.runtime import StopSignal, may_be_broken_off
signal.signal(signal.SIGTERM, StopSignal())
{before}
print("up", flush=True)
time.sleep(2)
print("done", flush=True)
"""


@pytest.mark.parametrize(
    ("before", "rest"),
    [
        ("", "done\n"),
        ("step = may_be_broken_off(); step.__enter__()", ""),
        ("with may_be_broken_off(): pass", "done\n"),
    ],
)
def test_a_signal_ends_only_steps_that_may_be_broken_off(before: str, rest: str) -> None:
    code = BUSY.format(before=before)
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.terminate()
        assert process.stdout.read() == rest
        assert process.wait() == 0
