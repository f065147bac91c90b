"""The running driver: its topics, its life cycle, and the cycle that a command reaches."""

import math
import signal
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
import pytest
from integration.driver_stage import Stage, made
from integration.processes import DRIVER, PATIENCE, free_port, start
from laboratory_crane import JOINTS, PLANAR_JOINTS
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import JointState

from crane_interfaces.msg import ValveCommand

STEP = 0.0005  # of the spool signal
LOOPS = 90  # neutral commands that can be told apart


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), ["telescope=0.7", "slew=-0.25"])
    yield one
    one.close()


def test_topics_hold_what_the_machine_measures(stage: Stage) -> None:
    first = len(stage.states)
    stage.until(lambda: len(stage.states) > first + 100)
    state, pressures = stage.measured(), stage.pressures[-1]
    assert list(state.name) == list(JOINTS)
    assert state.position[0] == pytest.approx(-0.25, abs=0.01)
    assert state.position[3] == pytest.approx(0.7, abs=0.01)
    assert np.abs(state.velocity).max() < 0.05
    assert math.isnan(state.effort[0])
    assert state.effort[1] > 1000.0  # the booms' weight, N m
    assert list(pressures.name) == list(PLANAR_JOINTS)
    assert min(pressures.chamber_a[0], pressures.supply) > 1e5


def test_stamps_are_those_of_the_cycles(stage: Stage) -> None:
    first = len(stage.states)
    stage.until(lambda: len(stage.states) > first + 200)
    stamps = [made(one) for one in stage.states[first:]]
    assert np.diff(stamps) == pytest.approx(0.005)


def test_the_urdf_comes_to_whoever_asks_late(stage: Stage) -> None:
    stage.until(lambda: stage.description)
    robot = ET.fromstring(stage.description[0])
    assert {one.get("name") for one in robot.iter("joint")} >= set(JOINTS)


def test_diagnostics_name_safety_bus_and_every_message(stage: Stage) -> None:
    stage.report()
    assert {name for name in stage.diagnostics if name.startswith("driver: ")} == {
        "driver: safety",
        "driver: bus",
        *(f"driver: {one.name}" for one in stage.layout.readings),
    }
    assert stage.diagnostics["driver: bus"][1] == "active"


def test_the_driver_can_be_taken_down_and_up_again(stage: Stage) -> None:
    change = stage.node.create_client(ChangeState, "driver/change_state")
    ask = stage.node.create_client(GetState, "driver/get_state")
    stage.until_there(lambda: change.service_is_ready() and ask.service_is_ready())

    def to(transition: int) -> int:
        request = ChangeState.Request(transition=Transition(id=transition))
        changed = change.call_async(request)
        stage.until(changed.done)
        assert changed.result().success
        state = ask.call_async(GetState.Request())
        stage.until(state.done)
        return state.result().current_state.id

    assert to(Transition.TRANSITION_DEACTIVATE) == State.PRIMARY_STATE_INACTIVE
    assert stage.call("enable") == (False, "enable: the driver is inactive; activate it first")
    assert to(Transition.TRANSITION_CLEANUP) == State.PRIMARY_STATE_UNCONFIGURED
    assert to(Transition.TRANSITION_CONFIGURE) == State.PRIMARY_STATE_INACTIVE
    before = len(stage.states)
    assert to(Transition.TRANSITION_ACTIVATE) == State.PRIMARY_STATE_ACTIVE
    stage.until(lambda: len(stage.states) > before + 10)
    stage.disabled()


def test_a_command_reaches_the_valves_in_the_cycle_that_it_answers(stage: Stage) -> None:
    publisher = stage.node.create_publisher(ValveCommand, "/valve_command", 10)
    stage.until_there(lambda: publisher.get_subscription_count() == 1)
    sent: dict[int, float] = {}  # by value, the time of the joint state that it answers

    def answer(state: JointState) -> None:
        if len(sent) == LOOPS:
            return
        if stage.valves[-1].enabled:
            sent[len(sent) + 1] = made(state)
        command = ValveCommand(name=["slew"], command=[len(sent) * STEP])
        command.header.stamp = state.header.stamp
        publisher.publish(command)

    stage.listen(JointState, "joint_states", answer)
    since = len(stage.enabled().valves)
    stage.until(lambda: len(sent) == LOOPS)
    told = {round(one.commands["slew"] / STEP): one.steady for one in stage.valves[since:]}
    stage.node.destroy_publisher(publisher)
    for count in range(2, LOOPS - 1):
        assert told[count] == pytest.approx(sent[count], abs=1e-6)


def test_an_idle_driver_waits_to_be_configured(stage: Stage) -> None:
    options = ["-p", "autostart:=false", "-p", f"bus.options:=port={free_port()}"]
    driver = start(DRIVER, "--ros-args", "-r", "__node:=idle", *options)
    try:
        stage.until(lambda: "idle: safety" in stage.diagnostics)
        assert stage.diagnostics["idle: safety"][1] == "the node is unconfigured"
        assert driver.poll() is None
    finally:
        driver.send_signal(signal.SIGINT)
        assert driver.wait(PATIENCE) == 0
