"""The command line of a node: help, and what is refused before ROS starts."""

import pytest

from crane_nodes import Number, Numbers, Switch, Text
from crane_nodes.managed import check_arguments, own_arguments

PARAMETERS = (
    Text("model", "", "Model file"),
    Switch("autostart", True, "Start"),
    Number("lag", 0.2, "s", 0.05, 2.0, "Half the window"),
    Numbers("resolution", (0.1, 0.2), "rad", 0.0, 1.0, "One count"),
)


def check(*argv: str) -> None:
    check_arguments("node", "Does this and that.", PARAMETERS, argv)


def test_help_shows_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        check("--help")
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert "Does this and that." in shown
    for text in (
        "model (default: empty)\n      Model file",
        "autostart (default: true)",
        "lag (default: 0.2)\n      Half the window. Unit: s, range: [0.05 - 2]",
        "resolution (default: [0.1, 0.2])",
    ):
        assert text in shown


def test_arguments_of_ros_are_left_to_ros() -> None:
    check("--ros-args", "-p", "lag:=1", "-r", "__node:=other")
    assert own_arguments(["--joy", "--ros-args", "-p", "lag:=1", "--", "BAG"]) == ["--joy", "BAG"]


def test_other_arguments_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        check("--lag", "1")
    assert ended.value.code == 2
    assert "node: error: unrecognized arguments: --lag 1" in capsys.readouterr().err


def test_what_ros_cannot_read_is_an_error_of_one_line() -> None:
    with pytest.raises(SystemExit, match="Couldn't parse parameter override rule: '-p lag'") as end:
        check("--ros-args", "-p", "lag")
    assert ".c:" not in str(end.value)
