"""CANopen devices by the bytes of CiA 301, written down here from the standard."""

from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from crane_driver import Fault, FaultKind, constants, load_layout
from crane_driver.can.canopen import Devices, NodeState
from crane_driver.can.frame import Frame
from crane_driver.can.mapping import Device
from crane_model import ConfigurationError, load_machine
from crane_model.machine_files import machine_file

BOOTED, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
START_5 = Frame(0x000, bytes([0x01, 5]))
PERIOD_100_MS = Frame(0x605, bytes.fromhex("2B 17 10 00 64 00 00 00"))
CONFIRMED = bytes.fromhex("60 17 10 00 00 00 00 00")
NO_SUCH_OBJECT = bytes.fromhex("80 17 10 00 00 00 02 06")
TIMEOUT = 0.5


def devices(**options: object) -> Devices:
    return Devices({"encoder": Device.model_validate({"id": 5, "heartbeat_timeout": TIMEOUT}
                                                     | options)})  # fmt: skip


def beat(crane: Devices, state: int, now: float) -> Sequence[Fault]:
    faults = crane.observe(Frame(0x705, bytes([state]), steady=now))
    assert faults is not None
    return faults


def kinds(faults: Sequence[Fault] | None) -> list[FaultKind]:
    assert faults is not None
    return [one.kind for one in faults]


def running(**options: object) -> Devices:
    crane = devices(**options)
    assert not beat(crane, OPERATIONAL, 0.0)
    assert crane.operational
    return crane


def test_a_device_that_boots_is_started_and_then_operational() -> None:
    crane = devices()
    assert not beat(crane, BOOTED, 0.0)
    assert crane.start(0.0) == [START_5]
    assert not crane.operational, "not by the command, but by what the device says"
    assert not beat(crane, OPERATIONAL, 0.1)
    assert crane.operational
    assert crane.start(5.0) == []


def test_starting_is_tried_again_once_a_second() -> None:
    crane = devices()
    sent = [
        len(crane.start(0.01 * step)) for step in range(int(3.5 * constants.START_RETRY_S / 0.01))
    ]
    assert sum(sent) == 4
    assert max(sent) == 1


def test_a_heartbeat_period_is_written_before_the_start_and_anew_after_a_boot() -> None:
    crane = devices(heartbeat_period=0.1)
    assert crane.start(0.0) == [PERIOD_100_MS]
    assert crane.start(0.5) == []
    assert crane.observe(Frame(0x585, CONFIRMED)) == []
    assert crane.start(0.51) == [START_5]
    beat(crane, BOOTED, 0.6)
    assert crane.start(0.61) == [PERIOD_100_MS]


def test_a_refused_heartbeat_period_is_told_and_the_device_is_not_started() -> None:
    crane = devices(heartbeat_period=0.1)
    crane.start(0.0)
    crane.observe(Frame(0x585, NO_SUCH_OBJECT))
    assert "heartbeat period refused: Code 0x06020000" in crane.nodes[0].problem
    assert crane.start(constants.START_RETRY_S) == [PERIOD_100_MS]


def test_the_answer_to_another_master_changes_nothing() -> None:
    crane = devices(heartbeat_period=0.1)
    assert crane.observe(Frame(0x585, CONFIRMED)) == []
    assert crane.start(0.0) == [PERIOD_100_MS]


def test_a_heartbeat_that_stops_is_one_fault_and_may_come_back() -> None:
    crane = running()
    assert not crane.check(TIMEOUT)
    (fault,) = crane.check(TIMEOUT + 0.01)
    assert str(fault) == "encoder (705): heartbeat: none for 510 ms, limit 500 ms"
    assert not crane.check(TIMEOUT + 1.0)
    assert not crane.operational
    assert not beat(crane, OPERATIONAL, 3.0)
    assert crane.operational


def test_a_gap_counts_even_if_nobody_looked_during_it() -> None:
    crane = running()
    assert kinds(beat(crane, OPERATIONAL, TIMEOUT + 0.2)) == [FaultKind.HEARTBEAT]
    assert crane.operational


@pytest.mark.parametrize(
    ("state", "kind"),
    [
        (BOOTED, FaultKind.REBOOT),
        (STOPPED, FaultKind.NOT_OPERATIONAL),
        (PRE_OPERATIONAL, FaultKind.NOT_OPERATIONAL),
        (0x33, FaultKind.NOT_OPERATIONAL),
    ],
)
def test_a_device_that_leaves_operation_is_a_fault_once(state: int, kind: FaultKind) -> None:
    crane = running()
    assert kinds(beat(crane, state, 0.1)) == [kind]
    assert not crane.operational
    assert not beat(crane, state, 0.2)


@pytest.mark.parametrize("emergency", ["report", "fault"])
def test_an_emergency_is_reported_and_a_fault_if_the_mapping_says_so(emergency: str) -> None:
    crane = running(emergency=emergency)
    frame = Frame(0x085, bytes.fromhex("10 42 09 01 02 03 04 05"))
    assert kinds(crane.observe(frame)) == ([FaultKind.EMERGENCY] if emergency == "fault" else [])
    text = "Code 0x4210, Temperature, register 0x09, data 01 02 03 04 05"
    assert crane.take_log() == [f"encoder (085): emergency: {text}"]
    assert crane.nodes[0].watch.active == {0x4210: text}
    crane.observe(frame)
    assert not crane.take_log()  # said already
    assert not crane.observe(Frame(0x085, bytes(8)))  # error reset
    assert not crane.nodes[0].watch.active


@pytest.mark.parametrize("identifier", [0x705, 0x085, 0x585])
@pytest.mark.parametrize("size", [0, 2, 7])
def test_a_message_of_the_wrong_size_is_a_fault_and_not_used(identifier: int, size: int) -> None:
    crane = running()
    assert kinds(crane.observe(Frame(identifier, bytes(size)))) == [FaultKind.WRONG_SIZE]
    assert crane.nodes[0].watch.state is NodeState.OPERATIONAL


def test_other_frames_are_left_to_others() -> None:
    crane = devices()
    assert crane.observe(Frame(0x706, b"\x05")) is None
    assert crane.observe(Frame(0x705, b"\x05", extended=True)) is None
    assert crane.observe(Frame(0x185, bytes(8))) is None  # its process data are of the DBC


def load(folder: Path, canopen: dict[str, object], encoder: int = 0x120) -> None:
    """The laboratory's mapping with devices, and its DBC with another id of EncoderBase."""
    mapping, dbc = folder / "mapping.yaml", folder / "crane.dbc"
    text = machine_file("can.yaml").read_text()
    mapping.write_text(yaml.safe_dump({**yaml.safe_load(text), "canopen": canopen}))
    text = machine_file("can.dbc").read_text()
    dbc.write_text(text.replace("BO_ 288 EncoderBase", f"BO_ {encoder} EncoderBase"))
    load_layout(load_machine(), mapping, dbc)


@pytest.mark.parametrize(
    ("canopen", "message"),
    [
        (
            {"a": {"id": 5, "heartbeat_timeout": 0.5}, "b": {"id": 5, "heartbeat_timeout": 0.5}},
            "a and b have the same node id 5",
        ),
        ({"a": {"id": 128, "heartbeat_timeout": 0.5}}, "at most 127"),
        ({"a": {"id": 5, "heartbeat_timeout": 0.0}}, "greater than 0"),
        (
            {"a": {"id": 5, "heartbeat_timeout": 0.1, "heartbeat_period": 0.1}},
            "heartbeat_period is 0.1 s, it must be less than heartbeat_timeout, 0.1 s",
        ),
    ],
    ids=["twice", "no node", "timeout", "period"],
)
def test_wrong_devices_are_refused_when_the_mapping_is_loaded(
    canopen: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load(tmp_path, canopen)


@pytest.mark.parametrize(
    ("identifier", "use"),
    [(0x705, "heartbeat of a"), (0x085, "emergency of a"), (0x000, "network management")],
)
def test_a_mapped_message_with_the_id_of_a_device_is_refused(
    identifier: int, use: str, tmp_path: Path
) -> None:
    message = f"message EncoderBase has the id {identifier:03X}, that of the {use}"
    with pytest.raises(ConfigurationError, match=message):
        load(tmp_path, {"a": {"id": 5, "heartbeat_timeout": 0.5}}, encoder=identifier)
