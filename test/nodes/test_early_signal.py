"""A signal that comes before rclpy listens ends a node all the same."""

import subprocess
import sys

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
