"""One joint on the software sensor: simulated crane, driver and position sensor as processes."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from integration.driver_stage import Stage, commander
from integration.processes import RUN, end, start
from unit.crane_observer.observed import known

from crane_interfaces.msg import DriverState, PositionEstimate
from crane_interfaces.srv import SubstituteEncoder
from crane_model.model_file import save_model
from crane_nodes.driver_client import DriverClient

SENSOR = RUN.format(module="crane_observer.node.position_sensor_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
POSE_JOINTS = tuple(entry.partition("=")[0] for entry in POSE)
LOST = "outer_boom"


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    made = Stage(tmp_path, POSE)
    yield made
    made.close()


def substituted(stage: Stage, joint: str) -> tuple[bool, str]:
    client = stage.node.create_client(SubstituteEncoder, "driver/substitute")
    stage.until(client.service_is_ready)
    future = client.call_async(SubstituteEncoder.Request(joint=joint))
    stage.until(future.done)
    answer = future.result()
    assert answer is not None
    return answer.success, answer.message


@pytest.mark.realtime
def test_a_joint_goes_on_by_the_position_sensor_until_that_ends(
    tmp_path: Path, stage: Stage
) -> None:
    save_model(tmp_path / "model.yaml", known())
    estimates: list[PositionEstimate] = []
    stage.node.create_subscription(PositionEstimate, "position_estimate", estimates.append, 10)
    client = DriverClient(stage.node)
    given = {"model": tmp_path / "model.yaml", "start": "[0.5, -1.3, 0.6]"}
    parameters = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    sensor = start(SENSOR, "--ros-args", *parameters)
    try:
        stage.until(lambda: estimates or sensor.poll() is not None)
        stage.disabled()
        assert substituted(stage, LOST)[0]
        stage.until(lambda: math.isnan(stage.states[-1].position[POSE_JOINTS.index(LOST)]))
        with commander(stage) as moved:
            moved.send(**{LOST: 0.0})
            stage.enabled()
            stage.until(lambda: client.state.state == DriverState.STATE_DEGRADED)
            assert client.state.substituted == LOST
            assert LOST in client.problem  # which keeps experiments from beginning
            end(sensor)
            stage.until(lambda: client.state.state == DriverState.STATE_FAULT)
            assert client.state.fault == DriverState.FAULT_ESTIMATE
            assert client.state.source == LOST
            stage.until(lambda: not stage.valves[-1].enabled)
    finally:
        end(sensor)


@pytest.mark.realtime
def test_a_substitute_is_refused_while_the_crane_is_enabled(stage: Stage) -> None:
    with commander(stage) as moved:
        moved.send(**{LOST: 0.0})
        stage.enabled()
        done, why = substituted(stage, LOST)
        assert not done and "disable first" in why
