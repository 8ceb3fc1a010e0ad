"""A node that was started by an exploration ends with it."""

from __future__ import annotations

import subprocess
import sys

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
