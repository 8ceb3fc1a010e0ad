"""The examples of ``docs/library.md`` run as they stand, each in a process of its own, without ROS."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
EXAMPLES = dict(
    zip(
        re.findall(r"^## .*: (.*)$", TEXT, flags=re.MULTILINE),
        re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL),
        strict=True,
    )
)
FORBID_ROS = "import sys\nsys.modules['rclpy'] = None\n"
EXPECTED = {
    "the ask/tell optimizer": r"best: .*\n(solution: .*\n){2,4}",
    "the grasp simulator": r"(GRASPED|COLLISION|NO_CONTACT) \d",
    "the archive": r"0.31 with 1 of 2 blocked\ndiverse: \[0.42, 0.31\]\n",
}


@pytest.mark.parametrize("name", EXPECTED)
def test_the_example_runs_without_ros(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FORBID_ROS + EXAMPLES[name]], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(EXPECTED[name] + "(.*\n)?", done.stdout), done.stdout
