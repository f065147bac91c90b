"""Values to frames and back, and everything that is refused."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from unit.crane_driver.driven import disowned

from crane_driver import DriverCodec, FaultKind, MachineCodec, load_layout
from crane_driver.can.codec import frame_crc
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_model import RangeError, load_machine
from crane_model.machine_files import machine_file

JOINTS = load_machine().joint_names
CRANE = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
PRESSURE = 5e6
AT_REST = {"slew": 0.0, "inner_boom": 0.3, "outer_boom": -1.2, "telescope": 0.4}
UNDER_LOAD = dict.fromkeys(CRANE.pressures, PRESSURE)
commands = st.fixed_dictionaries({}, optional={joint: st.floats(-1, 1) for joint in JOINTS})


def encoder_frame(codec: MachineCodec, **positions: float) -> Frame:
    return codec.reading_frame("EncoderBase", AT_REST | positions, UNDER_LOAD, {})


def protected(frame: Frame, layout: Layout, change: bytes) -> Frame:
    """`frame` with other bytes behind byte 0, and the checksum that belongs to them."""
    data_id = next(
        one.protection.data_id for one in layout.readings if one.message.frame_id == frame.id
    )
    data = b"\0" + change
    return frame._replace(data=bytes((frame_crc(data, 0, data_id),)) + change)


@given(commands, st.booleans())
def test_commands_arrive_within_half_a_step(command: dict[str, float], enabled: bool) -> None:
    (frame,) = DriverCodec(CRANE).command_frames(command, enabled)
    received = MachineCodec(CRANE).decode(frame)
    assert received is not None
    assert received.enabled is enabled
    assert received.commands.keys() == set(JOINTS)
    for joint, value in received.commands.items():
        assert value == pytest.approx(command.get(joint, 0.0), abs=0.0005 / 2 + 1e-12)


@given(st.floats(-6.28, 6.28), st.floats(-6.28, 6.28))
def test_positions_arrive_within_half_a_step(slew: float, inner_boom: float) -> None:
    frame = encoder_frame(MachineCodec(CRANE), slew=slew, inner_boom=inner_boom)
    readings = DriverCodec(CRANE).decode(frame)
    assert readings is not None
    assert readings.positions == pytest.approx(
        {"slew": slew, "inner_boom": inner_boom}, abs=4.794e-5 / 2 + 1e-12
    )


@given(st.lists(st.floats(0, 25e6), min_size=8, max_size=8))
def test_pressures_arrive_within_half_a_step(values: list[float]) -> None:
    pressures = dict(zip(CRANE.pressures, values, strict=True))
    machine, driver = MachineCodec(CRANE), DriverCodec(CRANE)
    received = {}
    for message in ("PressureBooms", "PressureTelescope"):
        readings = driver.decode(machine.reading_frame(message, AT_REST, pressures, {}))
        assert readings is not None
        received |= readings.pressures
    assert received == pytest.approx(pressures, abs=25e6 / 4095 / 2 * (1 + 1e-9))


def test_a_reading_carries_the_stamps_of_its_frame(crane: Layout) -> None:
    frame = encoder_frame(MachineCodec(crane))._replace(stamp=1_700_000_000_123_456_789, steady=4.5)
    readings = DriverCodec(crane).decode(frame)
    assert readings is not None
    assert (readings.stamp, readings.steady) == (1_700_000_000_123_456_789, 4.5)


def test_neutral_frames_are_neutral_and_not_enabled(crane: Layout) -> None:
    (frame,) = DriverCodec(crane).neutral_frames()
    assert frame.data[1] == 0  # counter 0, not enabled
    assert frame.data[2:] == bytes(6)
    received = MachineCodec(crane).decode(frame)
    assert received is not None
    assert received.enabled is False
    assert set(received.commands.values()) == {0.0}


@pytest.mark.parametrize("value", [1.0001, -1.0001, math.nan, math.inf, -math.inf])
def test_a_command_beyond_its_limits_is_refused_by_name(crane: Layout, value: float) -> None:
    codec = DriverCodec(crane)
    with pytest.raises(RangeError, match=rf"outer_boom is {value}, limits -1 and 1; the whole"):
        codec.command_frames({"slew": 0.1, "outer_boom": value}, enabled=True)
    (frame,) = codec.neutral_frames()
    assert frame.data[1] & 0x0F == 0, "a refused command must not move the counter on"


def test_a_command_for_an_unknown_joint_is_refused_by_name(crane: Layout) -> None:
    with pytest.raises(RangeError, match="valve command for gripper, but there are valves for"):
        DriverCodec(crane).command_frames({"gripper": 0.0}, enabled=True)


def test_a_reading_that_a_frame_cannot_carry_is_refused_by_name(crane: Layout) -> None:
    with pytest.raises(RangeError, match="position telescope is 4.2, TelescopePosition carries"):
        MachineCodec(crane).reading_frame(
            "EncoderBoom", AT_REST | {"telescope": 4.2}, UNDER_LOAD, {}
        )


def test_counters_run_from_0_to_14_for_each_message(crane: Layout) -> None:
    machine, driver = MachineCodec(crane), DriverCodec(crane)
    counters = []
    for _ in range(16):
        readings = driver.decode(encoder_frame(machine))
        assert readings is not None
        counters.append(readings.counter)
    assert counters == [*range(15), 0]
    assert encoder_frame(machine).data[1] & 0x0F == 1
    (command,) = driver.neutral_frames()
    assert command.data[1] & 0x0F == 0


def test_unknown_identifiers_are_counted(crane: Layout) -> None:
    codec = DriverCodec(crane)
    frame = encoder_frame(MachineCodec(crane))
    for other in (frame._replace(id=0x7FF), frame._replace(extended=True), frame._replace(id=272)):
        assert codec.decode(other) is None
    assert codec.decode(frame) is not None
    assert codec.unknown == {(0x7FF, False): 1, (0x120, True): 1, (272, False): 1}


@pytest.mark.parametrize("length", [0, 7, 9])
def test_a_frame_of_the_wrong_size_holds_nothing(crane: Layout, length: int) -> None:
    frame = encoder_frame(MachineCodec(crane))
    readings = DriverCodec(crane).decode(frame._replace(data=(frame.data + b"\0")[:length]))
    assert readings is not None
    assert not readings.positions
    (fault,) = readings.faults
    where = "encoders of slew, inner_boom, EncoderBase (120)"
    assert str(fault) == f"{where}: wrong size: {length} bytes, the DBC says 8"


def test_a_damaged_frame_holds_nothing(crane: Layout) -> None:
    frame = encoder_frame(MachineCodec(crane))
    damaged = frame._replace(data=frame.data[:7] + bytes((frame.data[7] ^ 0x10,)))
    readings = DriverCodec(crane).decode(damaged)
    assert readings is not None
    assert not readings.positions
    assert [fault.kind for fault in readings.faults] == [FaultKind.CHECKSUM]


def test_a_frame_under_the_identifier_of_another_is_found_out(crane: Layout) -> None:
    """Masquerading: the data id is part of the checksum."""
    frame = encoder_frame(MachineCodec(crane))
    readings = DriverCodec(crane).decode(frame._replace(id=0x121))
    assert readings is not None
    assert [fault.kind for fault in readings.faults] == [FaultKind.CHECKSUM]


def test_a_reading_out_of_range_is_no_measurement(crane: Layout) -> None:
    frame = encoder_frame(MachineCodec(crane))
    # slew 0x800000, as an encoder writes it that has lost its disc
    wrong = protected(frame, crane, frame.data[1:2] + b"\x00\x00\x80" + frame.data[5:])
    readings = DriverCodec(crane).decode(wrong)
    assert readings is not None
    assert readings.positions.keys() == {"inner_boom"}
    (fault,) = readings.faults
    assert fault.kind is FaultKind.OUT_OF_RANGE
    assert "slew is -402" in fault.detail


def test_a_reading_that_its_sensor_disowns_is_no_measurement(crane: Layout) -> None:
    frame = MachineCodec(crane).reading_frame("PressureBooms", AT_REST, UNDER_LOAD, {})
    readings = DriverCodec(crane).decode(disowned(frame, ("outer_boom.a",), crane))
    assert readings is not None
    assert readings.pressures.keys() == {"inner_boom.a", "inner_boom.b", "outer_boom.b"}
    (fault,) = readings.faults
    assert (fault.kind, fault.detail) == (FaultKind.SENSOR, "outer_boom.a: OuterBoomAFault is set")


@pytest.mark.parametrize(
    ("state", "healthy"),
    [("Neutral", True), ("Enabled", True), ("CommandTimeout", False), ("9", False)],
)
def test_the_state_of_the_valves_is_read_and_judged(
    crane: Layout, state: str, healthy: bool
) -> None:
    frame = MachineCodec(crane).reading_frame("ValveStatus", {}, {}, {"valve_unit": state})
    readings = DriverCodec(crane).decode(frame)
    assert readings is not None
    assert readings.states == {"valve_unit": state}
    assert [fault.kind for fault in readings.faults] == [] if healthy else [FaultKind.STATE]


def test_sign_and_zero_act_as_the_mapping_says(crane: Layout) -> None:
    """joint = sign * (reading - zero)."""
    message = next(one for one in crane.readings if one.name == "EncoderBase")
    slew, inner = message.positions
    turned = replace(slew, gain=-slew.gain, offset=0.7)  # sign -1, zero 0.7
    other = replace(
        crane, readings=(replace(message, positions=(turned, inner)), *crane.readings[1:])
    )
    frame = encoder_frame(MachineCodec(crane), slew=1.0)
    readings = DriverCodec(other).decode(frame)
    assert readings is not None
    assert readings.positions["slew"] == pytest.approx(-(1.0 - 0.7), abs=4.794e-5)
