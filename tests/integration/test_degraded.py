"""One joint on the software sensor: simulated crane, driver and position sensor as processes."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from integration.commander import Commander
from integration.driver_stage import Stage, commander
from integration.processes import PATIENCE, RUN, end, start
from unit.crane_observer.observed import known

from crane_interfaces.msg import DriverState, PositionEstimate
from crane_interfaces.srv import SubstituteEncoder
from crane_model.machine import load_machine
from crane_model.model_file import save_model
from crane_nodes.driver_client import DriverClient

SENSOR = RUN.format(module="crane_observer.node.position_sensor_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
POSE_JOINTS = tuple(entry.partition("=")[0] for entry in POSE)
LOST = "outer_boom"
WAY, OPEN = 0.1, -0.3  # rad; of the stroke: more than its limit of speed lets through
SPAN = 0.25  # s, over which speed is taken
SHARE = 0.3  # of Table 2, `degraded` in safety.yaml
ESTIMATED = 0.02  # rad
LATE = (
    DriverState.FAULT_COMMAND_TIMEOUT,
    DriverState.FAULT_ESTIMATE,
    DriverState.FAULT_NO_STATE,
)


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


def travelled(stage: Stage, client: DriverClient, moved: Commander) -> None:
    """The lost joint goes some way by the estimate, no faster than a degraded crane may."""
    begun, course = stage.encoders[LOST], [(time.monotonic(), stage.encoders[LOST])]
    deadline, begins = time.monotonic() + PATIENCE, False
    while begun - stage.encoders[LOST] < WAY:
        assert time.monotonic() < deadline, course[-1]
        if not begins or not stage.valves[-1].enabled:
            # a test machine that is too busy makes true faults
            assert client.state.fault in (DriverState.FAULT_NONE, *LATE), client.state.fault
            moved.send(**{LOST: 0.0})  # with which every series of commands begins
            stage.enabled()
            stage.within(lambda: False, SPAN)
            moved.send(**{LOST: OPEN})
            begins = stage.within(lambda: stage.valves[-1].commands[LOST] != 0.0, 1.0)
        stage.spin()
        course.append((time.monotonic(), stage.encoders[LOST]))
    moved.send(**{LOST: 0.0})
    when, where = np.array(course).T
    behind = np.maximum(np.searchsorted(when, when - SPAN) - 1, 0)
    long = when - when[0] > SPAN
    speeds = np.abs(where - where[behind])[long] / (when - when[behind])[long]
    table = -load_machine().limits[LOST].velocity_min
    assert 0.1 * table < speeds.max() < 2.0 * SHARE * table  # what a late test machine adds
    stage.until(lambda: not np.any(list(stage.valves[-1].commands.values())))


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
            travelled(stage, client, moved)
            newest = estimates[-1]
            estimate = newest.position[newest.name.index(LOST)]
            assert estimate == pytest.approx(stage.encoders[LOST], abs=ESTIMATED)
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
