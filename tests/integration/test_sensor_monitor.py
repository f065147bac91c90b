"""The sensor monitor as a process: a plug is pulled at the simulated crane while it moves."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from integration.driver_stage import LATCHED, Stage, commander
from integration.faults import operate
from integration.jogging import hold, jogging
from integration.processes import PATIENCE, RUN, start
from unit.crane_observer.observed import known

from crane_interfaces.msg import DriverState, SensorFindings, ValveCommand
from crane_model import Model, save_model
from crane_model.configuration import save
from crane_nodes import DriverClient
from crane_observer import unlearnt
from crane_observer.monitor.replay import Heed

MONITOR = RUN.format(module="crane_observer.node.sensor_monitor_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
DIAGNOSED = "sensor_monitor: sensors"
UP = "k"  # the key that raises the inner boom


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    made = Stage(tmp_path, POSE, operator=True)
    yield made
    made.close()


@contextmanager
def monitored(
    folder: Path, stage: Stage, model: Model | None = None
) -> Iterator[list[SensorFindings]]:
    """What the monitor tells while it watches; nothing at first."""
    save_model(folder / "model.yaml", model or known())
    told: list[SensorFindings] = []
    stage.node.create_subscription(SensorFindings, "sensor_findings", told.append, LATCHED)
    process = start(MONITOR, *stage.ros(model=folder / "model.yaml"))
    try:
        stage.until_there(lambda: DIAGNOSED in stage.diagnostics or process.poll() is not None)
        assert process.poll() is None
        yield told
    finally:
        assert stage.end(process) == 0


def found(told: list[SensorFindings]) -> bool:
    return any(one.sensor for one in told)


def go_on(stage: Stage, states: int) -> None:
    """Until as many joint states more have come."""
    since = len(stage.states)
    stage.until(lambda: len(stage.states) > since + states)


def first_found(stage: Stage, told: list[SensorFindings]) -> SensorFindings:
    """What is found first, which is an encoder of the outer boom that lies."""
    stage.until(lambda: found(told))
    first = next(one for one in told if one.sensor)
    assert list(first.sensor) == ["outer_boom encoder"]
    assert list(first.dangerous) == [True]
    return first


def test_an_encoder_that_freezes_in_mid_motion_is_named(tmp_path: Path, stage: Stage) -> None:
    with monitored(tmp_path, stage) as told, commander(stage) as hand:
        stage.moving(hand, outer_boom=-0.25)
        go_on(stage, 300)
        assert not found(told), "nothing was wrong yet"
        stage.until(lambda: stage.diagnostics[DIAGNOSED][1] == Heed.WATCHING.value)
        operate(stage, "fault=outer_boom.encoder.stuck")
        assert list(first_found(stage, told).joint) == ["outer_boom"]
        stage.until(lambda: stage.diagnostics[DIAGNOSED][0] != b"\x00")
        stage.until(lambda: not stage.valves[-1].enabled)
        somebody = stage.node.create_publisher(ValveCommand, "valve_command", 1)
        stage.until_there(lambda: somebody.get_subscription_count() > 1)
        somebody.publish(ValveCommand())  # by whose clock it is 1970
        go_on(stage, 300)
        stage.node.destroy_publisher(somebody)
        assert found(told[-1:]), "and what was found is not forgotten"


def test_a_finding_in_jog_stops_the_crane(tmp_path: Path, stage: Stage) -> None:
    """A drift is neither frozen nor a jump: the driver by itself would go on."""
    client = DriverClient(stage.node)

    def stopped() -> bool:
        return client.state.state == DriverState.STATE_FAULT

    with monitored(tmp_path, stage) as told, jogging(stage) as terminal:
        hold(stage, terminal, UP, 1.0)
        assert not found(told)
        operate(stage, "fault=inner_boom.encoder.drift=0.05")
        while not found(told):
            hold(stage, terminal, UP, 0.2)
        stage.until(stopped)
        assert client.state.fault == DriverState.FAULT_FAULTY_ENCODER
        assert client.state.source == "inner_boom"
        stage.until(lambda: not stage.valves[-1].enabled)

        def well() -> bool:
            return stage.call("reset_fault")[0] and stage.within(
                lambda: client.state.state == DriverState.STATE_DISABLED, 1.0
            )

        stage.until(well)
        done, why = stage.call("enable")
        assert not done and "let sensor_monitor forget it" in why


def test_without_hydraulics_an_encoder_that_jumps_is_named(tmp_path: Path, stage: Stage) -> None:
    """By less than the driver sees by itself."""
    bare = replace(known(), hydraulics=None)
    with monitored(tmp_path, stage, bare) as told:
        with commander(stage) as hand:
            stage.moving(hand, outer_boom=-0.25)
            go_on(stage, 300)
        go_on(stage, 600)
        assert not found(told), "nothing was wrong yet"
        stage.until(lambda: stage.diagnostics[DIAGNOSED][1] == Heed.ALONE.value)
        operate(stage, "fault=outer_boom.encoder.jump=0.005")
        assert list(first_found(stage, told).kind) == ["jump"]


def test_a_tolerance_without_hydraulics_is_refused(tmp_path: Path) -> None:
    save_model(tmp_path / "model.yaml", replace(known(), hydraulics=None))
    save(tmp_path / "tolerance.yaml", unlearnt(known().joints))
    given = [f"{name}:={tmp_path / name}.yaml" for name in ("model", "tolerance")]
    process = start(MONITOR, "--ros-args", "-p", given[0], "-p", given[1])
    assert process.wait(PATIENCE) == 1
