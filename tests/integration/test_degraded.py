"""One joint on the software sensor: simulated crane, driver and position estimator as processes."""

import math
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from integration.commander import Commander
from integration.driver_stage import Stage, commander
from integration.processes import RUN, end, start
from unit.crane_observer.observed import known

from crane_interfaces.msg import DriverState, PositionEstimate
from crane_interfaces.srv import SubstituteEncoder
from crane_model import load_machine, save_model
from crane_nodes import DriverClient

SENSOR = RUN.format(module="crane_observer.node.position_estimator_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
POSE_JOINTS = tuple(entry.partition("=")[0] for entry in POSE)
LOST = "outer_boom"
MIDDLE, WAY = -1.35, 0.1  # rad
OPEN = 0.3  # of the stroke: more than its limit of speed lets through
SPAN = 0.25  # s, over which speed is taken
SHARE = 0.3  # of Table 2, `degraded` in safety.yaml
ESTIMATED = 0.02  # rad


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    made = Stage(tmp_path, POSE)
    yield made
    made.close()


def substituted(stage: Stage, joint: str) -> tuple[bool, str]:
    client = stage.node.create_client(SubstituteEncoder, "driver/substitute")
    stage.until_there(client.service_is_ready)
    future = client.call_async(SubstituteEncoder.Request(joint=joint))
    stage.until(future.done)
    answer = future.result()
    assert answer is not None
    return answer.success, answer.message


def begun(stage: Stage, model: Path) -> subprocess.Popen[str]:
    """A position estimator that is told where the crane stands."""
    given = {"model": model, "start": str([stage.encoders[one] for one in POSE_JOINTS[1:]])}
    return start(SENSOR, *stage.ros(**given))


def fastest(stage: Stage, moved: Commander, side: float) -> float:
    """Of the lost joint while it goes some way by the estimate [rad/s]."""
    begins, course = stage.encoders[LOST], [(stage.time, stage.encoders[LOST])]
    moved.send(**{LOST: side * OPEN})
    while side * (stage.encoders[LOST] - begins) < WAY:
        assert stage.valves[-1].enabled, stage.safety
        stage.spin()
        course.append((stage.time, stage.encoders[LOST]))
    moved.send(**{LOST: 0.0})
    stage.until(lambda: not np.any(list(stage.valves[-1].commands.values())))
    when, where = np.array(course).T
    behind = np.maximum(np.searchsorted(when, when - SPAN) - 1, 0)
    long = when - when[0] > SPAN
    return float((np.abs(where - where[behind])[long] / (when - when[behind])[long]).max())


def test_a_joint_moves_by_the_position_estimator_until_it_ends(
    tmp_path: Path, stage: Stage
) -> None:
    model, limits = tmp_path / "model.yaml", load_machine().limits[LOST]
    save_model(model, known())
    estimates: list[PositionEstimate] = []
    stage.node.create_subscription(PositionEstimate, "position_estimate", estimates.append, 10)
    client = DriverClient(stage.node)
    stage.disabled()
    sensor = begun(stage, model)
    try:
        with commander(stage) as moved:
            stage.until(lambda: estimates or sensor.poll() is not None)
            assert substituted(stage, LOST)[0]
            lost = POSE_JOINTS.index(LOST)
            stage.until(lambda: math.isnan(stage.states[-1].position[lost]))
            moved.send(**{LOST: 0.0})  # with which every series of commands begins
            stage.until(lambda: stage.call("enable")[0])  # refused until an estimate has come
            stage.until(lambda: client.state.state == DriverState.STATE_DEGRADED)
            stage.until(lambda: stage.valves[-1].enabled)
            assert client.state.substituted == LOST
            assert LOST in client.problem  # which keeps experiments from beginning
            side = -1.0 if stage.encoders[LOST] > MIDDLE else 1.0  # where there is way to go
            table = limits.velocity_max if side > 0.0 else -limits.velocity_min
            speed = fastest(stage, moved, side)
            print(f"{speed / table:.2f} of the speed limit, permitted {SHARE}")
            assert 0.1 < speed / table < 1.25 * SHARE
            newest = estimates[-1]
            error = newest.position[newest.name.index(LOST)] - stage.encoders[LOST]
            assert abs(error) < ESTIMATED
            stage.end(sensor)
            stage.until(lambda: client.state.state == DriverState.STATE_FAULT)
            stage.until(lambda: not stage.valves[-1].enabled)
            assert client.state.fault == DriverState.FAULT_ESTIMATE
            assert client.state.source == LOST
    finally:
        end(sensor)


def test_a_substitute_is_refused_while_the_crane_is_enabled(stage: Stage) -> None:
    with commander(stage) as moved:
        moved.send(**{LOST: 0.0})
        stage.enabled()
        done, why = substituted(stage, LOST)
        assert not done and "disable first" in why
