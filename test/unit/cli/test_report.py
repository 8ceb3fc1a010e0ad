"""The table of grasps shows the figure that was optimized; the line of progress ends once."""

from __future__ import annotations

import io

import numpy as np

from mebo_grasp.cli.report import HEADER, NOISE_HEADER, ProgressLine, grasp_table
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose, QualityUnderNoise, StampedGrasp


def grasp(quality: float, epsilon: float, known: QualityUnderNoise | None = None) -> StampedGrasp:
    pose = Pose(np.array([0.01, -0.02, 0.03]))
    return StampedGrasp(1, Grasp(pose, GraspOutcome.GRASPED, quality, epsilon, under_noise=known))


def test_where_epsilon_was_optimized_it_is_shown_once() -> None:
    header, row = grasp_table([grasp(0.25, 0.25)]).splitlines()
    assert header == HEADER
    assert row.split()[1] == "0.2500"


def test_another_metric_has_a_column_in_front_of_the_figures_under_noise() -> None:
    known = QualityUnderNoise(0.5, 0.125, 0.25, 3)
    header, *rows = grasp_table([grasp(1.5e-7, 0.25, known), grasp(0.75, 0.25)]).splitlines()
    assert header.split()[-4:] == ["quality", *NOISE_HEADER.split()]
    assert [row.split()[-4:] for row in rows] == [["1.5e-07", "0.5000", "0.1250", "0.2500"], ["0.75", "-", "-", "-"]]
    assert {len(row) for row in rows} == {len(header)}


def test_a_file_is_told_once_that_all_trials_are_done() -> None:
    stream = io.StringIO()
    line = ProgressLine(stream)
    for done in (0, 1, 60, 60, 60):
        line.show(done, 60, 0.3464, 0.0)
    assert [text.split()[1] for text in stream.getvalue().splitlines()] == ["0/60", "60/60"]
