"""The identification node as a process on a real ROS graph, beside a crane that obeys the model."""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from integration.matched import wait_until_heard
from integration.processes import PATIENCE
from laboratory_crane import PLANAR_JOINTS
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from unit.crane_identification.online.online_crane import (
    START,
    TRUE_VALUES,
    crane,
    motion,
    record_log,
)

from crane_identification import Log
from crane_identification.online.estimator import OnlineOptions
from crane_identification.online.identification_node import main
from crane_identification.online.replay import replay
from crane_interfaces.msg import CylinderPressures, GeneralizedForces, ParameterEstimate
from crane_model import Record, load_model

DEEP = QoSProfile(depth=2000)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
AHEAD = 2.0  # s of readings that may be on their way: 400 of the 1000 that the node queues
ROWS = 20  # a second
FORGETTING = 0.9999
NAMES = ["telescope", "slew", "outer_boom", "inner_boom"]  # as another driver may order them


@pytest.fixture(scope="module")
def log() -> Log:
    return record_log(24.0)


@dataclass
class Stage:
    """A node beside the one under test, what it heard of it, and that one's process."""

    node: Node
    executor: SingleThreadedExecutor
    folder: Path
    process: subprocess.Popen[bytes] | None = None
    estimates: list[ParameterEstimate] = field(default_factory=list)
    forces: list[GeneralizedForces] = field(default_factory=list)
    reports: list[DiagnosticStatus] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.states = self.node.create_publisher(JointState, "/joint_states", DEEP)
        self.pressures = self.node.create_publisher(CylinderPressures, "/cylinder_pressures", DEEP)
        subscribe = self.node.create_subscription
        subscribe(ParameterEstimate, "/parameter_estimate", self.estimates.append, LATCHED)
        subscribe(GeneralizedForces, "/generalized_forces", self.forces.append, DEEP)
        subscribe(DiagnosticArray, "/diagnostics", lambda m: self.reports.extend(m.status), DEEP)

    def start(self, **parameters: object) -> None:
        prefix = Path(get_package_prefix("crane_identification"))
        program = prefix / "lib" / "crane_identification" / "identification"
        given = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
        with (self.folder / "output").open("w") as output:
            self.process = subprocess.Popen(
                [str(program), "--ros-args", *given],
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=self.folder,
            )

    @property
    def output(self) -> str:
        return (self.folder / "output").read_text()

    def wait(self, condition: Callable[[], object]) -> None:
        until = time.monotonic() + PATIENCE
        while not condition():
            assert self.process is None or self.process.poll() is None, self.output
            assert time.monotonic() < until, f"condition not met in time; {self.output}"
            self.executor.spin_once(timeout_sec=0.05)

    def wait_for_the_node(self) -> None:
        self.wait(
            lambda: (
                self.states.get_subscription_count()
                and self.pressures.get_subscription_count()
                and self.node.count_publishers("/generalized_forces")
                and self.node.count_publishers("/parameter_estimate")
            )
        )
        wait_until_heard(self.node, "/identification", self.wait)

    def play(self, log: Log) -> None:
        """Publish every reading, never so far ahead of the node that one could be lost."""
        assert log.pressure_a is not None and log.pressure_b is not None
        heard = len(self.forces)
        for i, seconds in enumerate(log.position.time):
            position = dict(zip(log.joints, log.position.value[i], strict=True), slew=0.1)
            state = JointState(name=NAMES, position=[position[name] for name in NAMES])
            stamp(state, log.start + round(seconds * 1e9))
            oil = CylinderPressures(
                name=list(log.joints),
                chamber_a=log.pressure_a.value[i].tolist(),
                chamber_b=log.pressure_b.value[i].tolist(),
            )
            stamp(oil, log.start + round(log.pressure_a.time[i] * 1e9))
            self.states.publish(state)
            self.pressures.publish(oil)
            rows = int((seconds - AHEAD) * ROWS)
            self.wait(lambda expected=heard + rows: len(self.forces) >= expected)

    def call(self, service: str) -> Trigger.Response:
        client = self.node.create_client(Trigger, service)
        self.wait(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.wait(future.done)
        self.node.destroy_client(client)
        return future.result()

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        assert self.process is not None
        self.process.send_signal(number)
        return self.process.wait(PATIENCE)


def stamp(message: Any, nanoseconds: int) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)


@pytest.fixture
def stage(ros_domain: int, tmp_path: Path) -> Iterator[Stage]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = Node("test", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    made = Stage(node, executor, tmp_path)
    yield made
    if made.process is not None and made.process.poll() is None:
        made.process.kill()
        made.process.wait()
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_estimate_over_topics_is_that_of_the_offline_recursion(stage: Stage, log: Log) -> None:
    """And it is saved, loaded again and predicts; a reset begins anew."""
    expected, forces = replay(crane(), log, OnlineOptions(forgetting=FORGETTING))
    solution = expected.solve()

    stage.start(forgetting=FORGETTING, model_output="fitted.yaml")
    stage.wait_for_the_node()
    stage.play(log)
    stage.wait(lambda: len(stage.forces) == len(forces))
    stage.wait(lambda: stage.estimates and stage.estimates[-1].samples == expected.samples)

    estimate = stage.estimates[-1]
    assert estimate.model == expected.model.name
    assert list(estimate.name) == [p.name for p in expected.model.parameters]
    assert list(estimate.unit) == [p.unit for p in expected.model.parameters]
    np.testing.assert_allclose(estimate.value, solution.values, rtol=1e-6)
    np.testing.assert_allclose(estimate.std_dev, solution.std_devs, rtol=1e-6)
    assert estimate.header.stamp.sec * 10**9 + estimate.header.stamp.nanosec == expected.stamp
    for heard, known in zip(stage.forces, forces, strict=True):
        np.testing.assert_allclose(heard.measured, known.measured, rtol=1e-9)
        np.testing.assert_allclose(heard.predicted, known.predicted, rtol=1e-6)
    assert list(stage.forces[0].name) == list(crane().joints)

    stage.reports.clear()
    stage.wait(lambda: stage.reports)
    recursion, checked = stage.reports[:2]
    assert (recursion.name, checked.name) == tuple(
        f"identification: {what}" for what in ("recursion", "recording")
    )
    assert checked.level == DiagnosticStatus.ERROR  # this log holds pressures below vacuum
    assert "vacuum" in checked.message
    counters = {entry.key: entry.value for entry in recursion.values}
    assert counters["samples [-]"] == str(expected.samples)
    assert counters["unmatched [-]"] == str(expected.matcher.unmatched)
    assert counters["gated share [-]"] == f"{expected.gated_share:.3f}"
    assert counters["undetermined [-]"] == "0"

    saved = stage.call("/identification/save_model")
    assert saved.success, saved.message
    model = load_model(stage.folder / "fitted.yaml")
    np.testing.assert_allclose(model.values, solution.values, rtol=1e-6)
    at = np.linspace(1.0, 20.0, 200)
    record = Record(model.joints, at, *motion(at))
    true_values = crane().with_estimate(TRUE_VALUES.astype(float), 0.0 * TRUE_VALUES, "true values")
    truth = true_values.predict(record)
    error = np.linalg.norm(model.predict(record) - truth, axis=0)
    assert (error < 0.02 * np.linalg.norm(truth, axis=0)).all()

    assert stage.call("/identification/reset_estimator").success
    refused = stage.call("/identification/save_model")
    assert not refused.success
    assert "0 rows do not determine J_FL" in refused.message
    assert stage.stop() == 0


def column_map(joint: str) -> dict[str, dict[str, str]]:
    """The topics of the suite, as if they were those of another machine."""
    states = {"topic": "/joint_states", "type": "sensor_msgs/msg/JointState"}
    cylinders = {"topic": "/cylinder_pressures", "type": "crane_interfaces/msg/CylinderPressures"}
    pressure = {"unit": "Pa", "index": joint}
    unit = "m" if joint == "telescope" else "rad"
    return {
        "position": {"field": "position", "unit": unit, "index": joint} | states,
        "pressure_a": {"field": "chamber_a"} | cylinders | pressure,
        "pressure_b": {"field": "chamber_b"} | cylinders | pressure,
    }


def test_a_late_listener_hears_the_last_estimate_of_topics_that_a_map_names(stage: Stage) -> None:
    content = {"joints": {joint: column_map(joint) for joint in PLANAR_JOINTS}}
    (stage.folder / "topics.yaml").write_text(yaml.safe_dump(content))
    stage.start(columns="topics.yaml")
    stage.wait_for_the_node()
    stage.play(record_log(6.0))
    stage.wait(lambda: stage.estimates and stage.estimates[-1].samples > 20)
    late: list[ParameterEstimate] = []
    stage.node.create_subscription(ParameterEstimate, "/parameter_estimate", late.append, LATCHED)
    stage.wait(lambda: late)
    heard = {(one.header.stamp.sec, one.header.stamp.nanosec, one.samples) for one in late}
    stage.wait(
        lambda: (
            heard
            & {(o.header.stamp.sec, o.header.stamp.nanosec, o.samples) for o in stage.estimates}
        )
    )
    assert late[0].samples > 20
    assert stage.stop(signal.SIGTERM) == 0


def test_missing_joints_and_silence_are_reported(stage: Stage) -> None:
    stage.start(timeout=0.5)
    stage.wait_for_the_node()
    stage.wait(
        lambda: any(
            one.level == DiagnosticStatus.WARN and "/joint_states silent" in one.message
            for one in stage.reports
        )
    )
    state = JointState(name=["inner_boom", "telescope"], position=[0.4, 0.2])
    stamp(state, START)
    stage.states.publish(state)
    stage.wait(
        lambda: any(
            one.level == DiagnosticStatus.ERROR
            and "/joint_states: holds inner_boom, telescope, but not outer_boom" in one.message
            for one in stage.reports
        )
    )
    assert stage.stop() == 0


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        ("lag:=long", "parameter 'lag': must be a number, got 'long'"),
        ("lag:=7", "parameter 'lag': must be from 0.05 to 2 s, got 7"),
        ("model:=nowhere.yaml", "nowhere.yaml: no such file"),
        ("columns:=nowhere.yaml", "nowhere.yaml: no such file"),
        ("autostart:=1", "parameter 'autostart': must be true or false, got 1"),
    ],
)
def test_wrong_parameters_end_the_node_with_a_reason(
    parameter: str, message: str, ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["--ros-args", "-p", parameter]) == 1
    out, err = capfd.readouterr()
    assert message in out + err
