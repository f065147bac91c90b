"""The reference names every node, parameter, service, action and topic, as nodes declare them."""

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest
import rclpy
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from integration.test_launch_files import declared
from manual import text
from rclpy.node import Node
from std_srvs.srv import Trigger

from crane_driver.driver_node import Driver
from crane_driver.jog.jog_node import Jog
from crane_identification.online.identification_node import Identification
from crane_model.machine import JOINTS
from crane_trajectory.trajectory_node import Trajectory

REFERENCE = text("docs/reference/nodes.md") + text("docs/reference/topics.md")
COMMANDS = text("docs/reference/command_line.md")
LAUNCH_FILES = text("docs/reference/launch_files.md")
NODES: dict[str, Callable[[], Node]] = {
    "driver": Driver,
    "trajectory": Trajectory,
    "identification": Identification,
    "jog": lambda: Jog(by_joystick=True),
}
PACKAGES = ("crane_driver", "crane_trajectory", "crane_identification", "crane_sim")
OF_EVERY_NODE = {"use_sim_time", "start_type_description_service"}
INHERITED = {"/rosout", "/parameter_events"}
JOINT = re.compile(rf"\b({'|'.join(JOINTS)})\b")
UNIT = re.compile(r"(?<=Unit: )[^,]+(?=,)")
HEADING = "| parameter | default | meaning |\n|---|---|---|\n"


@pytest.fixture(params=NODES)
def node(request: pytest.FixtureRequest, ros_domain: int) -> Iterator[Node]:
    """A node as it stands before it is configured."""
    rclpy.init(domain_id=ros_domain)
    made = NODES[request.param]()
    yield made
    made.destroy_node()
    rclpy.shutdown()


def shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value or "empty"
    if isinstance(value, float | int):
        return f"{value:g}"
    assert not isinstance(value, str) and hasattr(value, "__iter__")
    return ", ".join(f"{one:g}" for one in value) or "empty"


def unique(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def table(node: Node) -> str:
    """The parameters of a node; those that differ by joint and unit alone share a row."""
    rows: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name, parameter in node.get_parameters_by_prefix("").items():
        if name not in OF_EVERY_NODE:
            description = node.describe_parameter(name).description
            units = UNIT.findall(description)
            row = (JOINT.sub("JOINT", name), UNIT.sub("{unit}", JOINT.sub("JOINT", description)))
            rows.setdefault(row, []).append((shown(parameter.value), *(units or [""])))
    lines = []
    for (name, meaning), entries in rows.items():
        defaults, units = zip(*entries, strict=True)
        default = defaults[0] if len(unique(defaults)) == 1 else ", ".join(defaults)
        meaning = meaning.replace("{unit}", " or ".join(unique(units)))
        lines.append(f"| `{name}` | {default} | {meaning} |\n")
    return HEADING + "".join(lines)


def test_the_table_of_parameters_is_what_the_node_declares(node: Node) -> None:
    expected = table(node)
    assert expected in REFERENCE, f"parameters of {node.get_name()}; write:\n{expected}"


def test_services_are_named(node: Node) -> None:
    for service in node.services:
        if service.srv_type is Trigger:
            assert f"`~/{service.srv_name.rpartition('/')[2]}`" in REFERENCE, service.srv_name


def test_topics_are_named(node: Node) -> None:
    for entity in (*node.publishers, *node.subscriptions):
        topic = entity.topic_name
        if topic not in INHERITED and not topic.endswith("/transition_event"):
            assert f"`{topic}`" in REFERENCE, topic


@pytest.mark.parametrize("package", PACKAGES)
def test_every_executable_is_named(package: str) -> None:
    for program in (Path(get_package_prefix(package)) / "lib" / package).iterdir():
        assert re.search(rf"`({package} )?{program.name}`", COMMANDS), f"{package} {program.name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_launch_file_and_its_arguments_are_named(package: str) -> None:
    for path in (Path(get_package_share_directory(package)) / "launch").iterdir():
        assert f"| `{package} {path.name}` |" in LAUNCH_FILES
        assert all(f"`{name}`" in LAUNCH_FILES for name in declared(path))
