"""What can be set on a running node, as `ros2 param set` does it."""

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_driver.nodes.parameters import Number, Numbers, Switch, Text, declare, hold

LAG = Number("lag", 0.2, "s", 0.05, 2.0, "Half the window")
COUNT = Number("count", 3, "-", 0, 10, "A number of things", whole=True)
PARAMETERS = (
    *(LAG, COUNT, Text("file", "", "A file"), Switch("on", True, "A switch")),
    Numbers("list", (1.0, 2.0), "m", 0.0, 5.0, "A list"),
)


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    rclpy.init(domain_id=ros_domain)
    made = Node("parameters")
    declare(made, PARAMETERS)
    yield made
    made.destroy_node()
    rclpy.shutdown()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("lag", "fast", "parameter 'lag': must be a number, got 'fast'"),
        ("lag", 7, "parameter 'lag': must be from 0.05 to 2 s, got 7.0"),
        ("lag", float("nan"), "parameter 'lag': must be from 0.05 to 2 s, got nan"),
        ("count", 2.5, "parameter 'count': must be whole, got 2.5"),
        ("file", 5, "parameter 'file': must be text, got 5"),
        ("on", 1, "parameter 'on': must be true or false, got 1"),
        ("list", [1.0, 9.0], "parameter 'list': must be from 0 to 5 m, got 9.0"),
    ],
)
def test_what_a_node_could_not_use_is_refused(
    node: Node, name: str, value: object, reason: str
) -> None:
    before = node.get_parameter(name).value
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert result.reason == reason
    assert node.get_parameter(name).value == before


def test_a_whole_number_does_for_any_number(node: Node) -> None:
    (result,) = node.set_parameters([Parameter("lag", value=1)])
    assert result.successful
    assert node.get_parameter("lag").type_ is Parameter.Type.DOUBLE
    assert LAG.read(node) == 1.0
    assert node.get_parameter("count").type_ is Parameter.Type.INTEGER


def test_what_is_read_at_configure_is_held_while_the_node_is_configured(node: Node) -> None:
    state = "active"
    hold(node, (LAG,), lambda: state)
    (result,) = node.set_parameters([Parameter("lag", value=0.5)])
    assert not result.successful
    assert result.reason.startswith("parameter 'lag' is read when the node is configured, and the")
    for same in (Parameter("lag", value=0.2), Parameter("count", value=4)):
        assert node.set_parameters([same])[0].successful
    state = "unconfigured"
    assert node.set_parameters([Parameter("lag", value=0.5)])[0].successful
