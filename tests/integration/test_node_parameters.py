"""What can be set on a running node, as `ros2 param set` does it."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from from_code.nodes import NODES, unconfigured
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.configuration import bounds
from crane_model.machine_files import machine_file
from crane_nodes import Number, Numbers, Switch, Text, declare
from crane_nodes.parameters import hold
from crane_trajectory.control.controller import JointGains
from crane_trajectory.trajectory_node import Trajectory

LAG = Number("lag", 0.2, "s", 0.05, 2.0, "Half the window")
COUNT = Number("count", 3, "-", 0, 10, "A number of things", whole=True)
PARAMETERS = (
    *(LAG, COUNT, Text("file", "", "A file"), Switch("on", True, "A switch")),
    Numbers("list", (1.0, 2.0), "m", 0.0, 5.0, "A list"),
)
ONCE = Number("once", 1.0, "s", 0.0, 2.0, "Read at the start")


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    rclpy.init(domain_id=ros_domain)
    made = Node("parameters")
    declare(made, (*PARAMETERS, ONCE), read_only=(ONCE,))
    yield made
    made.destroy_node()
    rclpy.shutdown()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("lag", "fast", "parameter 'lag': must be a number, got 'fast'"),
        ("lag", 7, "Parameter lag out of range Min: 0.05, Max: 2.0, value: 7.0"),
        ("lag", float("nan"), "Parameter lag out of range Min: 0.05, Max: 2.0, value: nan"),
        ("count", 11, "Parameter count out of range. Min: 0, Max: 10, value: 11"),
        ("once", 0.5, "Trying to set a read-only parameter: once."),
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


def test_ros_knows_what_a_parameter_may_be(node: Node) -> None:
    lag, count, file, numbers, once = node.describe_parameters(
        ["lag", "count", "file", "list", "once"]
    )
    (of_lag,), (of_count,), (of_list,) = (
        lag.floating_point_range,
        count.integer_range,
        numbers.floating_point_range,
    )
    assert (of_lag.from_value, of_lag.to_value) == (LAG.lowest, LAG.highest)
    assert (of_count.from_value, of_count.to_value) == (COUNT.lowest, COUNT.highest)
    assert (of_list.from_value, of_list.to_value) == (0.0, 5.0)
    assert lag.description == "Half the window. Unit: s, range: [0.05 - 2]"
    assert not file.floating_point_range
    assert [one.read_only for one in (lag, count, file, numbers, once)] == [*[False] * 4, True]


@pytest.mark.parametrize("which", NODES)
def test_every_number_of_every_node_has_its_range(which: str, ros_domain: int) -> None:
    numbers = {Parameter.Type.DOUBLE, Parameter.Type.INTEGER}
    with unconfigured(which, domain=ros_domain) as made:
        for name, parameter in made.get_parameters_by_prefix("").items():
            if parameter.type_ in numbers:
                described = made.describe_parameter(name)
                assert described.floating_point_range or described.integer_range, name
        once = [one for one in ("autostart", "hold", "port") if made.has_parameter(one)]
        assert once and all(made.describe_parameter(one).read_only for one in once)


def test_the_range_of_a_gain_is_that_of_the_controller_file(
    trajectory: Callable[..., Trajectory],
) -> None:
    (kp,) = trajectory().describe_parameter("gains.slew.kp").floating_point_range
    assert (kp.from_value, kp.to_value) == bounds(JointGains, "kp")


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


def controller_file(path: Path, **slew: float) -> Path:
    """The packaged controller with other gains of the slew."""
    content = yaml.safe_load(machine_file("controller.yaml").read_text())
    path.write_text(yaml.safe_dump(content | {"slew": content["slew"] | slew}))
    return path


@pytest.fixture
def trajectory(ros_domain: int) -> Iterator[Callable[..., Trajectory]]:
    """Makes a node with parameters as the command line gives them, not configured yet."""
    nodes = []

    def make(**given: object) -> Trajectory:
        arguments = [f"{name.replace('__', '.')}:={value}" for name, value in given.items()]
        ros = [word for one in arguments for word in ("-p", one)]
        rclpy.init(args=["--ros-args", *ros] if ros else [], domain_id=ros_domain)
        nodes.append(Trajectory())
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def test_gains_are_those_of_the_controller_file_but_for_single_ones_that_are_given(
    trajectory: Callable[..., Trajectory], tmp_path: Path
) -> None:
    """2.0 is the packaged kp as well: given is given."""
    first = controller_file(tmp_path / "first.yaml", kp=3.0, kd=0.3)
    node = trajectory(controller=first, gains__slew__kp=2.0)

    def gains() -> list[float]:
        return [node.get_parameter(f"gains.slew.{name}").value for name in ("kp", "kd")]

    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS
    assert gains() == [2.0, 0.3]
    assert node._tuning is not None
    tuned = node._tuning.gains
    assert (tuned.kp[0], tuned.kd[0]) == (2.0, 0.3)
    second = Parameter("controller", value=str(controller_file(tmp_path / "second.yaml", kd=0.4)))
    (held,) = node.set_parameters([second])
    assert not held.successful
    node.trigger_cleanup()
    node.set_parameters([second, Parameter("gains.slew.standstill_speed", value=0.03)])
    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS
    assert gains() == [2.0, 0.4]
    assert node._tuning.gains.standstill_speed[0] == 0.03


def test_all_gains_may_be_given_as_a_dump_of_the_parameters_gives_them(
    trajectory: Callable[..., Trajectory],
) -> None:
    node = trajectory()
    dump = [one for name, one in node._parameters.items() if name.startswith("gains.")]
    assert all(result.successful for result in node.set_parameters(dump))
    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS


@pytest.mark.parametrize(
    ("slew", "reason"),
    [
        ({"kp": -1.0}, "slew.kp"),
        ({"kp": 2000.0, "position_tolerance": 1e-6}, "key 'slew.kp': must be at most 1000"),
        ({"kp": 100.0}, "kp times position_tolerance is 0.5, more than dead_band_positive"),
        (None, "no such file"),
    ],
)
def test_a_controller_file_that_cannot_be_used_is_named(
    slew: dict[str, float] | None,
    reason: str,
    trajectory: Callable[..., Trajectory],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "mine.yaml"
    if slew is not None:
        controller_file(file, **slew)
    assert trajectory(controller=file).trigger_configure() is TransitionCallbackReturn.FAILURE
    said = capfd.readouterr().err
    assert f"{file}" in said
    assert reason in said
