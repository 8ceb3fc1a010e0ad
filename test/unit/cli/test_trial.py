"""``mebo-grasp trial``: what it prints is what the simulator answers, and mistakes are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mebo_grasp.cli.main import EXIT_USAGE, main
from mebo_grasp.cli.trial import parse_pose, trial_text
from mebo_grasp.errors import InvalidPoseError, InvalidSettingsError
from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

POSE = (-0.045, 0.05, 0.01, -1.5707963, 0.0, 0.0)
WORDS = [str(value) for value in POSE]


def test_all_of_a_trial_is_printed_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "new" / "trial.png"
    assert main(["trial", "--pose", *WORDS, "--metric", "isotropy", "--engine", "fast", "--out", str(picture)]) == 0
    printed = capsys.readouterr().out
    settings = TrialSettings(engine="fast", quality="isotropy")
    with GraspSimulator(TargetObject.builtin("bottle"), HandModel.load("icub_left"), settings) as simulator:
        grasp = simulator.trial(Pose.from_rpy(POSE[:3], POSE[3:]))
        further = simulator.further_metrics(grasp)
    assert grasp.contacts
    for name, value in further.items():
        assert any(line.split() == [name, f"{value:.6g}"] for line in printed.splitlines())
    expected = [line for line in trial_text(grasp, settings, further).splitlines() if not line.startswith("outcome")]
    assert set(expected) <= set(printed.splitlines())
    assert f"quality  {grasp.isotropy:.6g} (isotropy)" in printed
    for contact in grasp.contacts:
        point = ", ".join(f"{value + 0.0:.2f}" for value in 1000 * contact.position)
        (line,) = [line for line in printed.splitlines() if line.split()[:2] == [contact.link, "point"]]
        assert f"({point}) mm" in line
    for name, value in zip(grasp.hand_posture.names, grasp.hand_posture.positions, strict=True):
        assert any(line.split() == [name, f"{np.degrees(value):.2f}"] for line in printed.splitlines()), (
            f"{name} is not printed"
        )
    with Image.open(picture) as image:
        colors = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colors, axis=0)) > 1000


def test_numbers_may_have_exponents(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", "--pose", "-5e-2", "0.056", "-1e-3", "-1.57", "0", "0"]) == 0
    assert "xyz (-50.00, 56.00, -1.00) mm" in capsys.readouterr().out


def test_without_a_pose_the_middle_of_the_position_space_is_tried(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial"]) == 0
    assert "outcome  GRASPED" in capsys.readouterr().out


def test_a_pose_is_read_with_angles_or_a_quaternion() -> None:
    angles = parse_pose("0.01 -2e-3, 0.3 0.1 0.2 -0.3")
    again = parse_pose(" ".join(str(v) for v in (*angles.position, *angles.quaternion_xyzw)))
    np.testing.assert_allclose(angles.position, [0.01, -0.002, 0.3], atol=1e-15)
    np.testing.assert_allclose(angles.rpy, [0.1, 0.2, -0.3], atol=1e-12)
    np.testing.assert_allclose(again.matrix, angles.matrix, atol=1e-12)


@pytest.mark.parametrize("text", ["1 2 3", "1 2 3 4 5 6 7 8", "a b c d e f", ""])
def test_other_than_six_or_seven_numbers_are_refused(text: str) -> None:
    with pytest.raises(InvalidSettingsError, match="--pose"):
        parse_pose(text)


@pytest.mark.parametrize("text", ["0 0 0 0 0 0 2", "nan 0 0 0 0 0", "0 0 inf 0 0 0 1"])
def test_poses_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InvalidPoseError):
        parse_pose(text)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "picture.txt"], ".png"),
        (["--object", "nothing.stl"], "nothing.stl"),
        (["--hand", "claw"], "claw"),
        (["--friction", "-1"], "friction"),
        (["--pose", "1", "2"], "6 (x y z roll pitch yaw)"),
        (["--position-noise", "0.01"], "give --repeat"),
        (["--repeat", "3"], "give any of --position-noise"),
        (["--repeat", "3", "--position-noise", "0.01", "--seed", "-1"], "--seed is -1"),
    ],
)
def test_mistakes_end_with_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", *arguments]) == EXIT_USAGE
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
