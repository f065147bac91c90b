"""The position estimator as a process: beside simulated crane and driver, and the command."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from integration.driver_stage import Stage, commander, made
from integration.matched import wait_until_heard
from integration.processes import PATIENCE, RUN, end, start
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from unit.crane_observer.observed import JOINTS, known, recording

from crane_interfaces.msg import CylinderPressures, PositionEstimate, ValveCommand
from crane_model import save_model
from crane_observer import HeardRecording, PositionEstimator
from crane_observer.position.replay import replay

NODE = RUN.format(module="crane_observer.node.position_estimator_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
WITHOUT = "outer_boom"
J = JOINTS.index(WITHOUT)
DEEP = QoSProfile(depth=1000)
MOVED, AT_REST = 0.1, 2e-3  # rad, rad/s
NAMED = "position_estimator: positions"


def test_a_joint_without_encoder_is_followed(tmp_path: Path, stage: Stage) -> None:
    save_model(tmp_path / "model.yaml", known())
    states: list[JointState] = []
    estimates: list[PositionEstimate] = []
    subscribe = stage.node.create_subscription
    subscribe(JointState, "joint_states_estimated", states.append, DEEP)
    subscribe(PositionEstimate, "position_estimate", estimates.append, DEEP)
    given = {"model": tmp_path / "model.yaml", "without": WITHOUT, "start": "[0.5, -1.3, 0.6]"}
    process = start(NODE, *stage.ros(**given))
    try:
        stage.until(lambda: estimates or process.poll() is not None)
        assert process.poll() is None
        assert estimates[-1].name == list(JOINTS)
        assert not estimates[-1].measured[J]
        begun = shown(stage.states[-1])
        with commander(stage) as moved:
            stage.moved(moved, lambda: begun - shown(stage.states[-1]) > MOVED, outer_boom=-0.25)
            moved.send(outer_boom=0.0)
            stage.measured(lambda state: abs(state.velocity[place(state)]) < AT_REST)
            rested = stage.now
            stage.until(lambda: made(states[-1]) > rested)
            way = begun - shown(stage.measured())
            assert begun - states[-1].position[J] == pytest.approx(way, rel=0.1)
        # pressures that stop are named, and the node goes on when they are back
        end(stage.driver)
        stage.until(lambda: "waiting" in stage.diagnostics.get(NAMED, (b"", "", {}))[1])
        stage.start_driver()
        again = stage.now
        stage.until(lambda: made(estimates[-1]) > again)
    finally:
        assert stage.end(process) == 0


def shown(message: JointState) -> float:
    """The encoder that the node is not to use [rad]."""
    return float(message.position[place(message)])


def place(message: JointState) -> int:
    """Of its joint in a message."""
    return list(message.name).index(WITHOUT)


def test_a_model_that_cannot_tell_two_joints_is_refused(tmp_path: Path) -> None:
    save_model(tmp_path / "model.yaml", replace(known(), hydraulics=None))
    given = {"model": tmp_path / "model.yaml", "without": "'outer_boom telescope'"}
    parameters = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    process = start(NODE, "--ros-args", *parameters)
    assert process.wait(PATIENCE) == 1


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    made = Stage(tmp_path, POSE)
    yield made
    made.close()


def test_the_node_tells_what_the_command_tells(tmp_path: Path, ros_domain: int) -> None:
    """Readings of a machine at work, as topics, against the same readings offline."""
    given, rows = recording(), range(1400)
    save_model(tmp_path / "model.yaml", known())
    hidden = np.array([joint == WITHOUT for joint in JOINTS])
    start_at = given.encoders[0]
    course = replay(PositionEstimator(known(), start_at), first(given, len(rows)), hidden)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = Node("crane", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    told: list[PositionEstimate] = []
    states: list[JointState] = []
    node.create_subscription(PositionEstimate, "position_estimate", told.append, DEEP)
    node.create_subscription(JointState, "joint_states_estimated", states.append, DEEP)
    publishers = [
        node.create_publisher(kind, topic, DEEP)
        for kind, topic in (
            (JointState, "joint_states"),
            (ValveCommand, "valve_command"),
            (CylinderPressures, "cylinder_pressures"),
        )
    ]
    begin = f"[{', '.join(f'{q:.9f}' for q in start_at)}]"
    words = {"model": tmp_path / "model.yaml", "without": WITHOUT, "start": begin}
    parameters = [word for name, value in words.items() for word in ("-p", f"{name}:={value}")]
    process = start(NODE, "--ros-args", *parameters)

    def until(condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert process.poll() is None and time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.01)

    try:
        until(lambda: all(one.get_subscription_count() for one in publishers))
        wait_until_heard(node, "/position_estimator", until)
        for k in rows:
            stamp = Time(sec=100, nanosec=0)
            stamp.sec += int(given.pressure_time[k])
            stamp.nanosec = round(given.pressure_time[k] % 1.0 * 1e9)
            state = JointState(name=list(JOINTS), position=given.encoders[k].tolist())
            command = ValveCommand(name=list(JOINTS), command=given.commands[k].tolist())
            oil = CylinderPressures(
                name=list(JOINTS),
                chamber_a=given.chamber_a[k].tolist(),
                chamber_b=given.chamber_b[k].tolist(),
                supply=float(given.supply[k]),
            )
            for publisher, message in zip(publishers, (state, command, oil), strict=True):
                message.header.stamp = stamp
                publisher.publish(message)
            until(lambda expected=(k - 20) // 10: len(told) >= expected)
        until(lambda: len(told) >= len(course.time) and len(states) >= len(course.time))
    finally:
        assert end(process) == 0
        node.destroy_node()
        rclpy.shutdown(context=context)
    np.testing.assert_allclose(states[-1].position, course.position[-1], atol=5e-4)
    np.testing.assert_allclose(told[-1].std_dev, course.deviation[-1], rtol=0.1)
    assert told[-1].measured == [joint != WITHOUT for joint in JOINTS]


def first(given: HeardRecording, count: int) -> HeardRecording:
    """Its first samples."""
    parts = {
        name: values[:count]
        for name, values in vars(given).items()
        if isinstance(values, np.ndarray)
    }
    return replace(given, **parts)
