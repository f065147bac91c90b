"""The reference names every node, parameter, service, action and topic, as nodes declare them."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from from_code.nodes import NODES, parameters, services, unconfigured
from integration.test_launch_files import declared
from laboratory_crane import JOINTS
from manual import text
from rclpy.node import Node

REFERENCE = text("docs/reference/nodes.md") + text("docs/reference/topics.md")
COMMANDS = text("docs/reference/command_line.md")
LAUNCH_FILES = text("docs/how_to/ros.md")
PACKAGES = (
    *("crane_driver", "crane_trajectory", "crane_identification", "crane_sim", "crane_nodes"),
    *("crane_observer", "crane_viewer", "crane_benchmark", "crane_model"),
)
INHERITED = {"/rosout", "/parameter_events"}
JOINTS_OF_MACHINE = "|".join(JOINTS)


@pytest.fixture(params=NODES)
def node(request: pytest.FixtureRequest, ros_domain: int) -> Iterator[Node]:
    """A node as it stands before it is configured."""
    with unconfigured(request.param, domain=ros_domain) as made:
        yield made


def test_the_table_of_parameters_has_all_that_the_node_declares(node: Node) -> None:
    table = parameters(node)
    for name, parameter in node.get_parameters_by_prefix("").items():
        if name in ("use_sim_time", "start_type_description_service"):
            continue
        row = re.search(rf"^\| `{re.sub(JOINTS_OF_MACHINE, 'JOINT', name)}` \|(.*)", table, re.M)
        assert row, name
        if isinstance(parameter.value, float):
            assert re.search(rf"(^|[ ,]){parameter.value:g}[ ,]", row[1]), name


def test_services_are_named(node: Node) -> None:
    for name in services(node):
        assert f"`~/{name}`" in REFERENCE, name


def test_topics_are_named(node: Node) -> None:
    for entity in (*node.publishers, *node.subscriptions):
        topic = entity.topic_name
        if topic not in INHERITED and not topic.endswith("/transition_event"):
            assert f"`{topic}`" in REFERENCE, topic


@pytest.mark.parametrize("package", PACKAGES)
def test_every_executable_is_named(package: str) -> None:
    for program in (Path(get_package_prefix(package)) / "lib" / package).iterdir():
        assert re.search(rf"`({package} )?{program.name}`", COMMANDS), f"{package} {program.name}"


@pytest.mark.parametrize("package", PACKAGES[:4])
def test_every_launch_file_and_its_arguments_are_named(package: str) -> None:
    for path in (Path(get_package_share_directory(package)) / "launch").iterdir():
        assert f"| `{package} {path.name}` |" in LAUNCH_FILES
        assert all(f"`{name}`" in LAUNCH_FILES for name in declared(path))
