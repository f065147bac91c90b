"""The policies of SROS2 allow each node what it does, and nobody else to command the valves."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from fnmatch import fnmatch

import pytest
from from_code.nodes import NODES, unconfigured
from from_code.parameter_files import ROOT
from rclpy.node import Node

POLICIES = ROOT / "src/crane_nodes/security/policies.xml"
COMMANDING = {"trajectory", "jog", "bringup"}
COMMANDS = re.compile(r"create_publisher\(ValveCommand, (\"valve_command\"|TOPIC),")


def allowed(kind: str, of: str, verb: str) -> dict[str, list[str]]:
    """Expressions that a profile allows, by the name of its node."""
    found = {}
    for profile in ElementTree.parse(POLICIES).iter("profile"):
        groups = [one for one in profile.iter(kind) if one.get(verb) == "ALLOW"]
        found[profile.attrib["node"]] = [
            str(one.text).lstrip("/") for group in groups for one in group.iter(of)
        ]
    return found


PUBLISHED = allowed("topics", "topic", "publish")


@pytest.fixture(params=NODES)
def node(request: pytest.FixtureRequest, ros_domain: int) -> Iterator[Node]:
    with unconfigured(request.param, domain=ros_domain) as made:
        yield made


def test_each_node_may_publish_what_it_does(node: Node) -> None:
    rules = [one.replace("~", node.get_name()) for one in PUBLISHED[node.get_name()]]
    for publisher in node.publishers:
        topic = publisher.topic_name.lstrip("/")
        assert any(fnmatch(topic, rule) for rule in rules), topic


def test_three_nodes_may_command_the_valves_and_only_those_do() -> None:
    for name, rules in PUBLISHED.items():
        assert any(fnmatch("valve_command", one) for one in rules) is (name in COMMANDING), name
    sources = [*ROOT.glob("crane_*/**/*.py"), *ROOT.glob("src/**/*.py")]
    commanding = [one for one in sources if COMMANDS.search(one.read_text("utf-8"))]
    assert len(commanding) == len(COMMANDING), commanding


def test_only_the_driver_says_where_joints_are() -> None:
    for name, rules in PUBLISHED.items():
        may = any(
            fnmatch(topic, one) for topic in ("joint_states", "driver/state") for one in rules
        )
        assert may is (name == "driver"), name
