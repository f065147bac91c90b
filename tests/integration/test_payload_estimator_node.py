"""The scale as a process, against the command on the same readings."""

import csv
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from integration.processes import PATIENCE, RUN, end, start
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from unit.crane_observer.observed import JOINTS, known, recording

from crane_interfaces.msg import CylinderPressures, SensorFindings, TipLoad
from crane_model import load_model, save_model
from crane_model.machine_files import machine_file
from crane_observer import HeardRecording
from crane_observer.node.payload_estimator_node import distrusted
from crane_observer.payload.estimator import HEADINGS, PayloadEstimator, lifts, replay

NODE = RUN.format(module="crane_observer.node.payload_estimator_node")
DEEP = QoSProfile(depth=1000)
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEGIN = 100  # s


def messages(given: HeardRecording, k: int) -> tuple[JointState, CylinderPressures]:
    stamp = Time(sec=BEGIN + int(given.pressure_time[k]))
    stamp.nanosec = round(given.pressure_time[k] % 1.0 * 1e9)
    state = JointState(name=list(JOINTS), position=given.encoders[k].tolist())
    oil = CylinderPressures(
        name=list(JOINTS),
        chamber_a=given.chamber_a[k].tolist(),
        chamber_b=given.chamber_b[k].tolist(),
        supply=float(given.supply[k]),
    )
    state.header.stamp = oil.header.stamp = stamp
    return state, oil


def test_the_node_tells_and_logs_what_the_command_does(tmp_path: Path, ros_domain: int) -> None:
    given = recording()
    model, log = tmp_path / "model.yaml", tmp_path / "lifts.csv"
    save_model(model, known())
    expected = replay(PayloadEstimator(known()), given)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = Node("crane", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    told: list[TipLoad] = []
    node.create_subscription(TipLoad, "tip_load", told.append, LATCHED)
    kinds = ((JointState, "joint_states"), (CylinderPressures, "cylinder_pressures"))
    publishers = [node.create_publisher(kind, topic, DEEP) for kind, topic in kinds]
    tare = node.create_client(Trigger, "payload_estimator/tare")
    process = start(NODE, "--ros-args", "-p", f"model:={model}", "-p", f"log:={log}")

    def until(condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert process.poll() is None and time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.01)

    def asked() -> Trigger.Response:
        future = tare.call_async(Trigger.Request())
        until(future.done)
        answer = future.result()
        assert answer is not None
        return answer

    try:
        until(lambda: all(one.get_subscription_count() for one in publishers))
        until(tare.service_is_ready)
        assert not asked().success, "nothing was weighed yet"
        for k in range(len(given.pressure_time)):
            for publisher, message in zip(publishers, messages(given, k), strict=True):
                publisher.publish(message)
            until(lambda expected=(k - 100) // 30: len(told) >= expected)
        until(lambda: len(told) >= len(expected) - 1)
        answer = asked()
        assert answer.success and "count as nothing now" in answer.message
    finally:
        assert end(process) == 0
        node.destroy_node()
        rclpy.shutdown(context=context)
    count = len(told)
    loads = [one.load.mass for one in expected[:count]]
    np.testing.assert_allclose([one.load for one in told], loads, atol=0.05)
    assert [one.condition for one in told] == [one.condition.name for one in expected[:count]]
    with log.open(encoding="utf-8") as file:
        heading, *rows = list(csv.reader(file))
    assert heading == list(HEADINGS)
    wanted = lifts(expected[:count])
    assert wanted and len(rows) == len(wanted)
    for row, lift in zip(rows, wanted, strict=True):
        assert float(row[0]) == pytest.approx(BEGIN + lift.picked_up, abs=0.01)
        assert float(row[3]) == pytest.approx(lift.load.mass, abs=0.05)


def test_a_log_that_exists_and_a_model_without_values_are_refused(tmp_path: Path) -> None:
    model, log = tmp_path / "model.yaml", tmp_path / "lifts.csv"
    save_model(model, known())
    log.write_text("of another day\n", encoding="utf-8")
    process = start(NODE, "--ros-args", "-p", f"model:={model}", "-p", f"log:={log}")
    assert process.wait(PATIENCE) == 1
    assert log.read_text(encoding="utf-8") == "of another day\n"
    save_model(tmp_path / "bare.yaml", load_model(machine_file("model.yaml")))
    process = start(NODE, "--ros-args", "-p", f"model:={tmp_path / 'bare.yaml'}")
    assert process.wait(PATIENCE) == 1


def test_findings_name_encoders_since_their_onset_and_pressures() -> None:
    found = SensorFindings(
        sensor=[
            "outer_boom encoder",
            "telescope pressure A",
            "inner_boom valve",
            "supply pressure",
        ],
        joint=["outer_boom", "telescope", "inner_boom", ""],
        dangerous=[True, False, False, False],
        onset=[107.5, 108.0, 109.0, 110.0],
    )
    encoders, pressures = distrusted(JOINTS, found, BEGIN * 10**9)
    assert dict(zip(JOINTS, encoders.tolist(), strict=True)) == {
        "inner_boom": np.inf, "outer_boom": 7.5, "telescope": np.inf,
    }  # fmt: skip
    assert dict(zip(JOINTS, pressures.tolist(), strict=True)) == {
        "inner_boom": False, "outer_boom": False, "telescope": True,
    }  # fmt: skip
