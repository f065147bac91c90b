"""Faults injected into the running driver and simulated crane; what the valves are sent then."""

import math
import os
import re
import signal
from collections.abc import Callable, Iterator

import pytest
from domain_coordinator import domain_id
from integration.commander import Commander
from integration.driver_stage import Stage
from integration.faults import (
    DEAF_MACHINE,
    SMALLEST,
    encoder_frame,
    fault,
    operate,
    ramped,
    seconds_told,
    swing,
)
from integration.processes import DRIVER, IMPATIENT, end, start

from crane_driver import DriverCodec, load_safety
from crane_interfaces.msg import ValveCommand
from crane_model import load_machine
from crane_model.machine_files import machine_file

SAFETY = load_safety(machine_file("safety.yaml"), load_machine())
SLACK = 0.02  # s, that the driver may take beyond its times


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(
        *(tmp_path_factory.mktemp("driver"), []),
        driver=IMPATIENT + DRIVER,
        simulation=DEAF_MACHINE,
        operator=True,
    )
    yield one
    one.close()


def test_a_publisher_that_stops_makes_the_valves_ramp_to_neutral(
    stage: Stage, hand: Commander
) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    hand.pause()
    paused = stage.now
    frames = ramped(stage, since)
    waited = seconds_told(r"last command (\d+) ms ago", fault(stage, "command timeout"))
    assert SAFETY.command_timeout <= waited <= SAFETY.command_timeout + SLACK
    held = [one for one in frames if abs(one.commands["slew"]) > 0.5 - SMALLEST]
    assert not held or held[-1].steady <= paused + SAFETY.command_timeout + SLACK
    hand.send(slew=0.5)
    count = len(stage.valves)
    stage.until(lambda: len(stage.valves) > count + 50)
    assert not any(one.enabled for one in stage.valves[count:])  # latched


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ({"slew": float("nan")}, "valve command for slew is nan, limits -1 and 1"),
        ({"slew": 0.5, "telescope": 1.5}, "valve command for telescope is 1.5"),
        ({"slew": 0.5, "elbow": 0.0}, "valve command for 'elbow', but there are valves for"),
    ],
    ids=["nan", "out of range", "unknown joint"],
)
def test_a_wrong_command_is_refused_as_a_whole_and_named(
    command: dict[str, float], reason: str, stage: Stage, hand: Commander
) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    hand.send(**command)
    frames = ramped(stage, since)
    assert {one.commands["telescope"] for one in frames} == {0.0}
    fault(stage, "command timeout")
    _, values = stage.safety
    assert values["last refusal"].startswith(reason)
    assert "the whole command is refused" in values["last refusal"]


def test_two_publishers_are_refused_and_reported(stage: Stage, hand: Commander) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    second = stage.node.create_publisher(ValveCommand, "/valve_command", 10)
    try:
        ramped(stage, since)
        assert "2 publishers command the valves" in fault(stage, "several publishers")
        hand.send(slew=0.0)

        def refused() -> bool:
            stage.disabled()
            success, text = stage.call("enable")
            return not success and "2 publishers command the valves; stop all but one" in text

        stage.until(refused)
    finally:
        stage.node.destroy_publisher(second)
    stage.enabled()


def test_a_machine_that_falls_silent_is_a_fault_and_nothing_is_published(
    stage: Stage, hand: Commander
) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    os.kill(stage.machine.pid, signal.SIGSTOP)
    try:
        ramped(stage, since)
        for name in ("late EncoderBase", "missing PressureBooms"):
            fault(stage, name)
        stage.spin()  # takes what was published before
        states, pressures = len(stage.states), len(stage.pressures)
        stage.until(lambda: stage.diagnostics["driver: EncoderBase"][1] == "missing")
        assert (len(stage.states), len(stage.pressures)) == (states, pressures)
    finally:
        os.kill(stage.machine.pid, signal.SIGCONT)
    stage.measured()
    assert stage.report()[0].startswith("fault")  # never enabled by itself
    success, text = stage.call("enable")
    assert not success
    # Of its devices, that comes first which was to send when the machine was stopped.
    assert re.match("not enabled: the state is fault; (encoders|pressures) of ", text), text
    stage.disabled()


def test_valves_that_do_not_accept_commands_are_a_fault(stage: Stage, hand: Commander) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    stage.machine.send_signal(signal.SIGUSR1)
    ramped(stage, since)
    said = fault(stage, "not accepted ValveStatus")
    waited = seconds_told(r"ValveCommand has been sent for (\d+) ms and none was", said)
    assert SAFETY.command_timeout <= waited <= SAFETY.command_timeout + SLACK
    stage.machine.send_signal(signal.SIGUSR1)
    stage.disabled()


def test_an_encoder_that_is_frozen_stops_the_crane(stage: Stage, hand: Commander) -> None:
    """Its frames come with right counters and checksums, and the valves accept their commands."""
    operate(stage, "fault=slew.encoder.stuck")
    swing(stage, hand)
    since = len(stage.valves)
    ramped(stage, since)
    said = fault(stage, "frozen slew")
    still = seconds_told(r"slew: frozen: its position has not changed for (\d+) ms", said)
    assert SAFETY.still_time <= still <= SAFETY.still_time + SLACK
    assert math.isnan(stage.measured().position[0])
    operate(stage, "repaired=slew.encoder")
    stage.disabled()


@pytest.mark.parametrize(
    ("damage", "name", "detail"),
    [
        (
            lambda data: bytes([data[0] ^ 0xFF]) + data[1:],
            "checksum EncoderBase",
            "EncoderBase (120): checksum: Crc is 0x",
        ),
        (lambda data: data[:6], "wrong size EncoderBase", "6 bytes, the DBC says 8"),
    ],
    ids=["checksum", "size"],
)
def test_a_damaged_frame_is_a_fault_and_is_not_published(
    damage: Callable[[bytes], bytes], name: str, detail: str, stage: Stage, hand: Commander
) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    frame = encoder_frame(stage)
    refused = int(stage.diagnostics["driver: EncoderBase"][2]["frames refused"])
    stage.link.send(frame._replace(data=damage(frame.data)))
    ramped(stage, since)
    assert detail in fault(stage, name)
    assert int(stage.diagnostics["driver: EncoderBase"][2]["frames refused"]) >= refused + 1


def test_a_wrong_counter_is_a_fault(stage: Stage, hand: Commander) -> None:
    """An old frame, whole and with a right checksum, comes in between."""
    swing(stage, hand)
    since = len(stage.valves)
    old = encoder_frame(stage)
    stage.frames.clear()
    stage.until(lambda: len([one for one in stage.frames if one.id == old.id]) >= 6)
    stage.link.send(old)
    ramped(stage, since)
    wrong = {"sequence EncoderBase", "repeated EncoderBase"}
    stage.until(lambda: wrong & stage.safety[1].keys())


def test_a_repeated_frame_is_a_fault(stage: Stage, hand: Commander) -> None:
    swing(stage, hand)
    since, states = len(stage.valves), len(stage.states)
    old = encoder_frame(stage)
    for _ in range(5):  # one of the machine's own may come before the first of them
        stage.link.send(old)
    ramped(stage, since)
    assert "EncoderBase (120): repeated: counter " in fault(stage, "repeated EncoderBase")
    stamps = [(one.header.stamp.sec, one.header.stamp.nanosec) for one in stage.states[states:]]
    assert stamps == sorted(set(stamps))


def test_a_valve_command_of_another_node_is_a_fault_in_every_state(
    stage: Stage, hand: Commander
) -> None:
    foreign = DriverCodec(stage.layout)
    stage.disabled()
    stage.link.send(foreign.command_frames({"inner_boom": 0.3}, True)[0])
    assert "another node commands the valves (" in fault(stage, "foreign command ValveCommand")
    swing(stage, hand)
    since = len(stage.valves)
    stage.link.send(foreign.command_frames({"inner_boom": 0.3}, True)[0])
    ramped(stage, since)
    assert "inner_boom 0.3" in fault(stage, "foreign command ValveCommand")
    stage.disabled()


def test_a_second_driver_on_the_bus_is_a_fault(
    stage: Stage, hand: Commander, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of another ROS domain, which no topic tells of; it is disabled, and sends neutral.

    It is in real time: two drivers on simulated time would both let the crane go on.
    """
    swing(stage, hand)
    with domain_id() as another:  # until it has ended: others take domains that are free
        monkeypatch.setenv("ROS_DOMAIN_ID", str(another))
        second = start(DRIVER, "--ros-args", "-p", f"bus.options:=port={stage.port}")
        try:
            fault(stage, "foreign command ValveCommand")
            success, text = stage.call("enable")
            assert not success
            assert "foreign command" in text
        finally:
            end(second)
    stage.disabled()
