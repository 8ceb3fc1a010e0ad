"""``explore`` before its nodes start: refused numbers, a folder in use, signals."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from mebo_grasp.cli.explore import _delete_run, name_from_anywhere, sole_user
from mebo_grasp.cli.main import main
from mebo_grasp.cli.stopping import STOP_SIGNALS, stop_at_signals


@pytest.mark.parametrize(
    ("option", "value"),
    [("--budget", "0"), ("--initial", "0"), ("--seed", "-1"), ("--size", "0"), ("--min-distance", "nan")],
)
def test_a_number_out_of_range_is_named_and_leaves_no_folder(
    option: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explore", option, value, "--out", str(tmp_path / "run")]) == 2
    assert option in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_second_exploration_in_a_folder_is_refused_and_deletes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "trials.db").write_text("of the first")
    with sole_user(tmp_path):
        assert main(["explore", "--out", str(tmp_path), "--restart"]) == 2
    assert "another exploration runs in" in capsys.readouterr().err
    assert (tmp_path / "trials.db").read_text() == "of the first"


def test_a_file_that_would_block_is_not_taken_for_a_second_exploration(tmp_path: Path) -> None:
    with pytest.raises(BlockingIOError, match="a pipe"), sole_user(tmp_path):
        raise BlockingIOError("a pipe")


def test_files_are_named_from_anywhere_and_built_in_names_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("bottle", "mine.yaml"):
        (tmp_path / name).touch()
    assert name_from_anywhere("bottle", ("bottle", "mug")) == "bottle"
    assert name_from_anywhere("mine.yaml", ("icub_left",)) == str(tmp_path / "mine.yaml")
    assert name_from_anywhere("unicorn", ("bottle",)) == "unicorn"


def test_restart_deletes_the_page_of_the_run_before_too(tmp_path: Path) -> None:
    for name in ("trials.db", "run.jsonl", "grasps.png", "grasps.html", "hand_node.log", "notes.txt"):
        (tmp_path / name).touch()
    _delete_run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_the_first_signal_is_noted_and_the_second_stops(number: signal.Signals) -> None:
    # Whoever runs the tests may have had it ignored, as nohup does.
    found = signal.signal(number, signal.default_int_handler)
    try:
        with stop_at_signals() as stop:
            os.kill(os.getpid(), number)
            assert stop.is_set()
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, found)


def test_under_nohup_a_closed_terminal_stops_nothing() -> None:
    found = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_at_signals() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, found)
