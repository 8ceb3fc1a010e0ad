"""The command line as a whole: every command is there, and asking for help loads none of them."""

import subprocess
import sys

import pytest

from mebo_grasp.cli.main import COMMANDS, main, make_parser

HEAVY = ("numpy", "scipy", "rclpy", "trimesh")


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_tells_its_options(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert f"mebo-grasp {command}" in shown
    assert len(shown.splitlines()) > 5


def test_the_list_of_commands_loads_none_of_them() -> None:
    code = (
        "import sys; from mebo_grasp.cli.main import make_parser; make_parser(None); "
        f"print(set({HEAVY}) & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_the_command_may_stand_behind_an_option_of_the_whole_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version", "best"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("mebo_grasp ")


def test_an_unknown_command_is_named_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["grasp"])
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert all(name in message for name in ("'grasp'", *COMMANDS))


def test_without_a_command_all_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    message = capsys.readouterr().err
    assert all(f"    {name} " in message or f"    {name}\n" in message for name in COMMANDS)


def test_only_the_chosen_command_has_a_function_to_run() -> None:
    assert callable(make_parser("doctor").parse_args(["doctor"]).run)
