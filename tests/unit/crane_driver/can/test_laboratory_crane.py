"""The DBC and the mapping of the laboratory crane itself."""

import numpy as np
import pytest

from crane_driver import DriverCodec, MachineCodec
from crane_driver.can.dbc import Dbc, load_dbc
from crane_driver.can.layout import Layout
from crane_driver.can.mapping import LINES
from crane_model import load_machine
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_model.sensors import SensorChain, in_counts

JOINTS = load_machine().joint_names


@pytest.fixture(scope="module")
def dbc() -> Dbc:
    return load_dbc(machine_file("can.dbc"))


@pytest.fixture(scope="module")
def sensors() -> SensorChain:
    return load(machine_file("sensors.yaml"), SensorChain)


def test_all_joints_cylinders_and_valves_are_mapped(crane: Layout) -> None:
    machine = load_machine()
    with_transducers = [joint for joint in JOINTS if machine.cylinders[joint].pressure_sensors]
    assert crane.positions == JOINTS
    assert crane.valves == JOINTS
    assert crane.pressures == (*(f"{one}.{ab}" for one in with_transducers for ab in "ab"), *LINES)


def test_a_cycle_is_its_encoders_and_pressures(crane: Layout) -> None:
    names = ("EncoderBase", "EncoderBoom", "PressureBooms", "PressureTelescope")
    by_name = {one.message.name: one.message.frame_id for one in crane.readings}
    assert crane.frames_of_cycle == {by_name[name] for name in names} < set(by_name.values())


def test_frames_are_as_fine_as_the_sensors(crane: Layout, sensors: SensorChain) -> None:
    for joint in JOINTS:
        assert crane.resolution(joint) <= sensors.encoder_resolution[joint]
    for pressure in crane.pressures:
        assert crane.resolution(pressure) == pytest.approx(sensors.pressure_step, rel=1e-12)


def test_what_sensors_measure_passes_the_bus_unchanged(crane: Layout, sensors: SensorChain) -> None:
    random = np.random.default_rng(3)
    limits = load_machine().limits
    machine, driver = MachineCodec(crane), DriverCodec(crane)
    for _ in range(50):
        low, high = (
            [getattr(limits[joint], end) for joint in JOINTS]
            for end in ("position_min", "position_max")
        )
        shown = in_counts(random.uniform(low, high), sensors.counts(JOINTS))
        positions = dict(zip(JOINTS, shown.tolist(), strict=True))
        true = random.uniform(0.0, sensors.pressure_range, len(crane.pressures))
        measured = sensors.measure_pressure(random, true)
        pressures = dict(zip(crane.pressures, measured.tolist(), strict=True))
        received: dict[str, float] = {}
        for message in machine.cycles:
            frame = machine.reading_frame(message, positions, pressures, {"valve_unit": "Neutral"})
            readings = driver.decode(frame)
            assert readings and not readings.faults
            received |= readings.positions | readings.pressures
        assert received == pytest.approx(positions | pressures, rel=1e-12, abs=1e-12)


def test_the_limits_of_the_joints_fit_into_the_frames(crane: Layout) -> None:
    limits = load_machine().limits
    channels = [one for message in crane.readings for one in message.positions]
    for channel in channels:
        assert channel.low < limits[channel.name].position_min
        assert channel.high > limits[channel.name].position_max


def test_the_bus_runs_at_200_hz_with_every_frame_protected(dbc: Dbc, crane: Layout) -> None:
    assert {name: one.cycle_time for name, one in dbc.messages.items()} == {
        "ValveCommand": 5,
        "EncoderBase": 5,
        "EncoderBoom": 5,
        "PressureBooms": 5,
        "PressureTelescope": 5,
        "ValveStatus": 10,
    }
    for message in (*crane.readings, *crane.commands):
        assert message.protection.counter_count == 15, message.name
        assert message.protection.data_id == message.message.frame_id, message.name


def test_identifiers_are_those_that_canopen_keeps_free(dbc: Dbc) -> None:
    for message in dbc.messages.values():
        assert 0x101 <= message.frame_id <= 0x180, message.name
        assert not message.is_extended_frame
    command = dbc.messages["ValveCommand"].frame_id
    assert command == min(one.frame_id for one in dbc.messages.values())  # wins the bus


def test_commands_and_states_say_what_they_do(dbc: Dbc) -> None:
    for name in ("ValveCommand", "ValveStatus"):
        assert dbc.messages[name].comment
