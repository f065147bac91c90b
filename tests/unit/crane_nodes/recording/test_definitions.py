"""Definitions of message types: of packages that nobody knew beforehand, and with their hash."""

import os
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from crane_interfaces.msg import ValveCommand
from crane_model import DataError
from crane_nodes.recording.bag import hash_of, installed_definition, message_class


@pytest.fixture
def odd_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with messages made of one another, installed in a prefix of its own."""
    prefix = tmp_path / "prefix"
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "odd_msgs").touch()
    folder = prefix / "share" / "odd_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text("std_msgs/Header header\nInner[] parts\nInner one\n")
    (folder / "Inner.msg").write_text("float64[3] values\nstring name\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}")


@pytest.mark.parametrize(
    "msgtype", ["sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"]
)
def test_types_of_ros_itself(msgtype: str) -> None:
    definition = installed_definition(msgtype)
    assert definition.encoding == "ros2msg"
    assert definition.type_hash == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(msgtype)


def test_types_of_any_installed_package(odd_package: None) -> None:
    definition = installed_definition("odd_msgs/msg/Outer")
    assert "MSG: odd_msgs/Inner" in definition.text
    assert "MSG: std_msgs/Header" in definition.text
    assert definition.type_hash.startswith("RIHS01_")


@pytest.mark.parametrize(
    "msgtype",
    [
        "absent_msgs/msg/Nothing",
        "crane_interfaces/msg/Nothing",
        "crane_interfaces/action/RunExcitation_FeedbackMessage",
    ],
)
def test_types_that_are_not_installed(msgtype: str) -> None:
    with pytest.raises(DataError, match=f"message type {msgtype} is not installed; build"):
        installed_definition(msgtype)
    with pytest.raises(DataError, match=f"message type {msgtype} is not installed; build"):
        message_class(msgtype)


def test_python_class() -> None:
    assert message_class("crane_interfaces/msg/ValveCommand") is ValveCommand


@pytest.mark.parametrize("msgtype", ["crane_interfaces/msg/ParameterEstimate", "std_msgs/msg/Int8"])
def test_hash_out_of_the_text(msgtype: str) -> None:
    definition = installed_definition(msgtype)
    assert hash_of(msgtype, definition.encoding, definition.text) == definition.type_hash


@pytest.mark.parametrize(("encoding", "text"), [("ros2msg", "no definition!"), ("ros2idl", "")])
def test_text_without_a_hash(encoding: str, text: str) -> None:
    assert hash_of("a/msg/B", encoding, text) == ""
