"""A command that compiles says so; one that does not says nothing."""

import time

import pytest

from mebo_grasp.cli.first_use import NOTICE, explained


def test_slow_work_is_explained_once_while_it_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    with explained(0.01):
        for _ in range(1000):
            time.sleep(0.01)
            heard = capsys.readouterr()
            if heard.err:
                break
    assert heard.err == NOTICE + "\n"
    assert heard.out == ""


def test_quick_work_and_failing_work_are_not(capsys: pytest.CaptureFixture[str]) -> None:
    with explained(0.2):
        pass
    with pytest.raises(ZeroDivisionError), explained(0.2):
        _ = 1 / 0
    time.sleep(0.4)
    assert capsys.readouterr().err == ""
