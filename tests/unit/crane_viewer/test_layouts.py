"""The layouts for other programs name topics, fields and joints of the suite, and nothing else."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import yaml
from laboratory_crane import JOINTS
from rosbags.interfaces import Nodetype

from crane_bags import TOPICS, typestore
from crane_bags.types import JOINT_STATES, ROBOT_DESCRIPTION

ROOT = Path(__file__).resolve().parents[3]
FOLDER = ROOT / "src" / "crane_viewer" / "layouts"
TYPES = {one.name: one.msgtype for one in TOPICS}
NUMBERS = {"float64", "float32", "int32", "uint8", "uint32", "uint64"}


def field_of(topic: str, path: str) -> tuple[str, bool]:
    """Base type of a field, such as `position[1]`, and whether one element of an array is named.

    `KeyError` if there is none.
    """
    name, index = re.fullmatch(r"(\w+)(\[\d+\])?", path).groups()  # type: ignore[union-attr]
    kind, what = dict(typestore().fielddefs[TYPES[topic]][1])[name]
    if kind == Nodetype.SEQUENCE:
        return what[0][1][0], index is not None
    assert index is None, f"{topic} {path}: no array"
    return what[0], True


def foxglove() -> dict[str, Any]:
    layout: dict[str, Any] = json.loads((FOLDER / "foxglove.json").read_text(encoding="utf-8"))
    return layout


def plotted_by_foxglove() -> list[str]:
    panels = foxglove()["configById"].items()
    return [line["value"] for name, one in panels if name[:5] == "Plot!" for line in one["paths"]]


def plotted_by_plotjuggler() -> list[str]:
    tree = ElementTree.parse(FOLDER / "plotjuggler.xml")
    return [curve.attrib["name"] for curve in tree.iter("curve")]


@pytest.mark.parametrize("line", plotted_by_foxglove())
def test_foxglove_plots_numbers(line: str) -> None:
    topic, _, path = line.partition(".")
    kind, single = field_of(topic, path)
    assert kind in NUMBERS
    assert single


@pytest.mark.parametrize("line", plotted_by_plotjuggler())
def test_plotjuggler_plots_numbers(line: str) -> None:
    """It names a value of joint states by the joint, other ones by their place."""
    topic, _, path = line.rpartition("/")
    if topic.startswith(JOINT_STATES.name + "/"):
        assert topic.removeprefix(JOINT_STATES.name + "/") in JOINTS
        kind, single = field_of(JOINT_STATES.name, f"{path}[0]")
    else:
        kind, single = field_of(topic, path)
    assert kind in NUMBERS
    assert single


@pytest.mark.parametrize("plotted", [plotted_by_foxglove(), plotted_by_plotjuggler()])
def test_each_shows_motion_pressures_commands_and_forces(plotted: list[str]) -> None:
    shown = {topic for topic in TYPES if any(line.startswith(topic) for line in plotted)}
    assert shown >= {
        *("/joint_states", "/joint_reference", "/cylinder_pressures", "/valve_command"),
        "/generalized_forces",
    }


def test_all_panels_of_foxglove_have_a_place_and_show_what_is_there() -> None:
    layout = foxglove()

    def placed(node: Any) -> set[str]:
        return {node} if isinstance(node, str) else placed(node["first"]) | placed(node["second"])

    panels = layout["configById"]
    assert placed(layout["layout"]) == set(panels)
    assert panels["DiagnosticSummary!all"]["topicToRender"] in TYPES
    assert panels["RawMessages!theta"]["topicPath"] in TYPES
    urdf = panels["3D!crane"]["layers"]["crane"]
    assert urdf["topic"] == ROBOT_DESCRIPTION.name
    for path in panels["StateTransitions!driver"]["paths"]:
        topic, _, field = path["value"].partition(".")
        assert field_of(topic, field) == ("string", True)
    assert not {name.partition("!")[0] for name in panels} & {"Publish", "CallService", "Teleop"}


def test_rviz_shows_the_machine_that_is_described() -> None:
    manager = yaml.safe_load((FOLDER / "crane.rviz").read_text())["Visualization Manager"]
    model = next(one for one in manager["Displays"] if one["Class"].endswith("RobotModel"))
    assert model["Description Topic"]["Value"] == ROBOT_DESCRIPTION.name
    assert ROBOT_DESCRIPTION.latched
    assert model["Description Topic"]["Durability Policy"] == "Transient Local"


def test_the_frame_that_stands_is_of_the_machine() -> None:
    from crane_model import load_machine
    from crane_model.urdf import urdf

    links = {
        one.attrib["name"] for one in ElementTree.fromstring(urdf(load_machine())).iter("link")
    }
    manager = yaml.safe_load((FOLDER / "crane.rviz").read_text())["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] in links
    assert foxglove()["configById"]["3D!crane"]["followTf"] in links
