"""The interfaces through a real ROS graph, and as bags know them."""

import math
import time
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from integration.processes import PATIENCE
from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import Header

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import (
    CylinderPressures,
    DriverState,
    GeneralizedForces,
    JointReference,
    ParameterEstimate,
    PositionEstimate,
    SensorFindings,
    TipLoad,
    ValveCommand,
)

DEFINITIONS = Path(__file__).resolve().parents[2] / "crane_interfaces"
JOINTS = ["inner_boom", "outer_boom", "telescope"]
HEADER = Header()
HEADER.stamp.sec, HEADER.stamp.nanosec = 12, 345_678_901

MESSAGES = [
    CylinderPressures(
        header=HEADER,
        name=JOINTS,
        chamber_a=[1.25e7, 0.0, -3.5],
        chamber_b=[8e6, 2.5e5, math.nan],
        supply=2.1e7,
        tank=math.nan,
    ),
    DriverState(
        header=HEADER,
        node="/left/driver",
        state=DriverState.STATE_FAULT,
        text="fault",
        fault=DriverState.FAULT_LATE,
        source="EncoderBoom",
        further_faults=3,
        cause="encoder of telescope: late",
        remedy="check the plug",
        commands_refused=2**32 - 1,
        last_refusal="größer als 1",
        substituted="outer_boom",
    ),
    GeneralizedForces(
        header=HEADER, name=JOINTS, measured=[1e4, -2e3, math.nan], predicted=[9.9e3, -1.9e3, 3e3]
    ),
    JointReference(
        header=HEADER,
        name=["slew", *JOINTS],
        position=[0.0, 0.1, -0.2, 0.3],
        velocity=[0.0, 1e-3, 2e-3, -3e-3],
        acceleration=[0.0, 1e-5, math.pi, 1e300],
    ),
    ParameterEstimate(
        header=HEADER,
        model="planär",
        name=["mass", "moment"],
        value=[180.5, -3.25],
        std_dev=[1.5, math.inf],
        unit=["kg", "kg*m"],
        samples=2**63 + 1,
    ),
    PositionEstimate(
        header=HEADER,
        name=["slew", "telescope"],
        position=[0.1, 0.7],
        velocity=[0.0, -0.2],
        std_dev=[1e-3, math.inf],
        measured=[True, False],
        observable=[True, False],
        covariance=[1e-6, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0, 4.0],
        load=95.5,
        load_std_dev=2.0,
        condition="ENCODER_LOST",
    ),
    SensorFindings(
        header=HEADER,
        sensor=["telescope encoder", "supply pressure"],
        joint=["telescope", ""],
        kind=["stuck", "offset"],
        unit=["", "Pa"],
        size=[1.0, -2e5],
        low=[1.0, -3e5],
        high=[1.0, -1e5],
        onset=[1.7e9, 1.7e9],
        dangerous=[True, False],
        what_to_do=["stop", "replace it"],
    ),
    TipLoad(
        header=HEADER,
        load=52.5,
        std_dev=0.5,
        centre=math.nan,
        centre_std_dev=math.nan,
        moved=2.4,
        changed=True,
        condition="GOOD",
    ),
    ValveCommand(header=HEADER, name=["slew"], command=[-1.0]),
]


@pytest.fixture
def graph(ros_domain: int) -> Iterator[tuple[Node, Node, Callable[..., None]]]:
    """Two nodes in a domain of their own, and `wait(condition)` that lets them work until it holds.

    The time given to `wait` bounds a failing test; a passing one ends with its condition.
    """
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    here, there = Node("here", context=context), Node("there", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(here)
    executor.add_node(there)

    def wait(condition: Callable[[], object], seconds: float = PATIENCE) -> None:
        until = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < until, "condition not met in time"
            executor.spin_once(timeout_sec=0.1)

    yield here, there, wait
    executor.shutdown()
    here.destroy_node()
    there.destroy_node()
    rclpy.shutdown(context=context)


def content(message: object) -> object:
    """Nested plain values of a message, comparable with NaN in them."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: content(getattr(message, name)) for name in type(message).__slots__}
    if isinstance(message, list | tuple | array):
        return [content(item) for item in message]
    return repr(message)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_message_arrives_as_it_was_sent(
    message: object, graph: tuple[Node, Node, Callable[..., None]]
) -> None:
    here, there, wait = graph
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    received: list[object] = []
    there.create_subscription(type(message), "/topic", received.append, qos)
    publisher = here.create_publisher(type(message), "/topic", qos)
    wait(lambda: publisher.get_subscription_count() and there.count_publishers("/topic"))
    publisher.publish(message)
    wait(lambda: received)
    assert content(received[0]) == content(message)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_bags_know_the_type_by_the_same_hash(
    message: object, graph: tuple[Node, Node, Callable[..., None]]
) -> None:
    """The hash that rosbags derives from the .msg text is the one on the wire."""
    here, there, wait = graph
    name = type(message).__name__
    typestore = get_typestore(Stores.ROS2_JAZZY)
    text = (DEFINITIONS / "msg" / f"{name}.msg").read_text()
    typestore.register(get_types_from_msg(text, f"crane_interfaces/msg/{name}"))

    here.create_publisher(type(message), "/topic", 1)
    wait(lambda: there.get_publishers_info_by_topic("/topic"))
    (publisher,) = there.get_publishers_info_by_topic("/topic")
    assert str(publisher.topic_type_hash) == typestore.hash_rihs01(f"crane_interfaces/msg/{name}")


def test_message_is_equal_when_read_from_its_bytes() -> None:
    """CDR written by rclpy is read by rosbags, which is how offline tools see a recording."""
    typestore = get_typestore(Stores.ROS2_JAZZY)
    name = "crane_interfaces/msg/ParameterEstimate"
    text = (DEFINITIONS / "msg" / "ParameterEstimate.msg").read_text()
    typestore.register(get_types_from_msg(text, name))
    (message,) = (m for m in MESSAGES if isinstance(m, ParameterEstimate))
    read = typestore.deserialize_cdr(serialize_message(message), name)
    assert read.model == "planär"
    assert list(read.std_dev) == [1.5, math.inf]
    assert read.samples == 2**63 + 1


def test_action_carries_goal_feedback_and_result(
    graph: tuple[Node, Node, Callable[..., None]],
) -> None:
    here, there, wait = graph

    def execute(goal: ServerGoalHandle) -> RunExcitation.Result:
        assert goal.request.trajectory == "excitation.yaml"
        goal.publish_feedback(
            RunExcitation.Feedback(
                phase=RunExcitation.Feedback.EXCITATION,
                elapsed=1.5,
                duration=20.0,
                name=JOINTS,
                tracking_error=[0.01, 0.02, 0.003],
            )
        )
        goal.succeed()
        return RunExcitation.Result(
            outcome=RunExcitation.Result.COMPLETED,
            message=f"{goal.request.periods} periods",
            name=JOINTS,
            rms_tracking_error=[0.01, 0.02, math.nan],
        )

    server = ActionServer(there, RunExcitation, "run_excitation", execute)
    client = ActionClient(here, RunExcitation, "run_excitation")
    wait(client.server_is_ready)
    feedback: list[RunExcitation.Feedback] = []
    sent = client.send_goal_async(
        RunExcitation.Goal(trajectory="excitation.yaml", periods=3),
        feedback_callback=lambda message: feedback.append(message.feedback),
    )
    wait(sent.done)
    finished = sent.result().get_result_async()
    wait(lambda: finished.done() and feedback)

    assert feedback[0].phase == RunExcitation.Feedback.EXCITATION
    assert list(feedback[0].tracking_error) == [0.01, 0.02, 0.003]
    result = finished.result().result
    assert result.outcome == RunExcitation.Result.COMPLETED
    assert result.message == "3 periods"
    assert math.isnan(result.rms_tracking_error[2])
    server.destroy()
    client.destroy()


def test_a_result_that_was_never_filled_in_is_no_success() -> None:
    """A node that dies in the middle leaves a default result."""
    assert RunExcitation.Result().outcome == RunExcitation.Result.UNKNOWN
    assert RunExcitation.Result.COMPLETED != RunExcitation.Result.UNKNOWN
