"""A signal that comes before rclpy listens ends a node all the same."""

import subprocess
import sys

import pytest

from test.nodes.harness import WAIT

SIGNALLED_BEFORE_INIT = """
import os, signal, rclpy
from rclpy.node import Node
from mebo_grasp.nodes.runtime import run_node
init = rclpy.init
def late(**options):
    os.kill(os.getpid(), signal.SIGINT)
    init(**options)
rclpy.init = late
run_node(lambda: Node("early"))
"""


def test_a_signal_before_rclpy_listens_ends_the_node() -> None:
    assert subprocess.run([sys.executable, "-c", SIGNALLED_BEFORE_INIT], timeout=WAIT, check=False).returncode == 0


SIGNALLED_WHILE_IMPORTED = """
import os, signal, sys
class SignalFinder:
    def find_spec(self, name, path, target=None):
        if name == "mebo_grasp.grasping":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, SignalFinder())
from mebo_grasp.nodes.executables import NODE
NODE()
"""


@pytest.mark.parametrize("node", ["optimizer_node", "hand_node", "solution_set_node"])
def test_ctrl_c_while_a_node_is_imported_ends_it_quietly(node: str) -> None:
    code = SIGNALLED_WHILE_IMPORTED.replace("NODE", node)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=WAIT, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


STOPPED_WHILE_READY = """
import rclpy
from rclpy.node import Node
from mebo_grasp.nodes.runtime import run_node
def make():
    node = Node("early")
    rclpy.shutdown()
    return node
run_node(make)
"""


def test_a_signal_between_a_node_and_its_executor_ends_it_quietly() -> None:
    command = [sys.executable, "-c", STOPPED_WHILE_READY]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
