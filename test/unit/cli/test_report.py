"""Tables and the line of progress name what they show."""

import io

import numpy as np

from mebo_grasp.cli.report import ProgressLine, grasp_table
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose, StampedGrasp


def stamped(quality: float, epsilon: float) -> StampedGrasp:
    return StampedGrasp(1, Grasp(Pose(np.zeros(3)), GraspOutcome.GRASPED, quality, epsilon=epsilon))


def test_a_quality_that_is_not_epsilon_has_a_column() -> None:
    head, row = grasp_table([stamped(0.3464, 0.1012)]).splitlines()
    assert head.split()[-1] == "quality"
    assert row.split()[-1] == "0.3464"
    assert "quality" not in grasp_table([stamped(0.1012, 0.1012)])


def test_a_file_is_told_once_that_all_trials_are_done() -> None:
    stream = io.StringIO()
    line = ProgressLine(stream, quality="simox_epsilon")
    for done in (0, 1, 60, 60, 60):
        line.show(done, 60, 0.3464, 0.0)
    shown = stream.getvalue().splitlines()
    assert [text.split()[1] for text in shown] == ["0/60", "60/60"]
    assert "best simox_epsilon 0.3464" in shown[-1]
