"""Sensors and valves that fail from a moment on: what each kind does, and how it is written."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_model import ConfigurationError, Machine, RangeError
from crane_model.machine_files import machine_file
from crane_sim import Plant, Sensors, SimulatedCrane, SimulatedRecording, record
from crane_sim.machine_on_bus import Operator
from crane_sim.sensor_faults import KINDS, Faults, parse, parts_of
from crane_trajectory import Motion, load_clearance, plan
from crane_trajectory.control.controller import load_gains
from crane_trajectory.motion.periodic import PeriodicTrajectory

JOINT, COLUMN, FITTED = "outer_boom", 2, 1  # column of positions, of pressures
ONSET = 0.5  # s
TIME = np.arange(0.0, 10.0, 0.005)
BEFORE = TIME < ONSET
WAVE = 0.3 * np.sin(2.0 * TIME) + 1.0  # a joint that goes to and fro


def shown(machine: Machine, fault: str, wave: np.ndarray = WAVE) -> np.ndarray:
    """What an encoder or a valve makes of a signal."""
    faults = Faults(machine, [f"{JOINT}.{fault}@{ONSET}"], seed=3)
    act = faults.commands if fault.startswith("valve") else faults.positions
    signals = np.tile(wave[:, None], (1, 4))
    out = np.array([act(t, row) for t, row in zip(TIME, signals, strict=True)])
    others = np.delete(out, COLUMN, axis=1)
    np.testing.assert_array_equal(others, np.delete(signals, COLUMN, axis=1))
    np.testing.assert_array_equal(out[BEFORE, COLUMN], wave[BEFORE])
    changed: np.ndarray = out[~BEFORE, COLUMN]
    return changed


def test_encoder_faults_do_what_their_names_say(machine: Machine) -> None:
    true, since = WAVE[~BEFORE], TIME[~BEFORE] - TIME[~BEFORE][0]
    rises = np.maximum(np.diff(true, prepend=true[0]), 0.0)
    np.testing.assert_array_equal(shown(machine, "encoder.stuck"), true[0])
    np.testing.assert_allclose(shown(machine, "encoder.jump=-0.03") - true, -0.03)
    np.testing.assert_allclose(shown(machine, "encoder.drift=0.002") - true, 0.002 * since)
    np.testing.assert_allclose(
        shown(machine, "encoder.scale=0.1") - true[0], 1.1 * (true - true[0])
    )
    np.testing.assert_allclose(
        shown(machine, "encoder.lost_counts=0.2"), true - 0.2 * np.cumsum(rises)
    )
    noise = shown(machine, "encoder.noise=0.004") - true
    assert np.std(noise) == pytest.approx(0.004, rel=0.1)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.1


def test_backlash_lags_by_half_its_width_to_either_side(machine: Machine) -> None:
    off = shown(machine, "encoder.backlash=0.02") - WAVE[~BEFORE]
    rising = np.gradient(WAVE[~BEFORE]) > 0.0
    assert np.abs(off).max() == pytest.approx(0.01)
    assert np.median(off[rising]) == pytest.approx(-0.01)
    assert np.median(off[~rising]) == pytest.approx(0.01)


def test_a_valve_sticks_or_lags(machine: Machine) -> None:
    step = np.where(TIME < 1.0, 0.0, 0.4)
    np.testing.assert_array_equal(shown(machine, "valve.stuck", step), 0.0)
    after = TIME[~BEFORE] - 1.0
    expected = np.where(after < 0.0, 0.0, 0.4 * (1.0 - np.exp(-(after + 0.005) / 0.2)))
    np.testing.assert_allclose(shown(machine, "valve.slow=0.2", step), expected, atol=1e-6)


@given(st.floats(-1e6, 1e6), st.floats(-0.5, 0.5))
def test_transducers(machine: Machine, offset: float, gain: float) -> None:
    a = np.linspace(1e6, 9e6, len(TIME))[:, None] * np.array([1.0, 0.5, 0.2])
    b, supply = 1e7 - a, np.full(len(TIME), 1.8e7)
    faults = Faults(machine, [
        f"{JOINT}.pressure_a.offset={offset!r}@{ONSET}", f"telescope.pressure_b.gain={gain!r}",
        "inner_boom.pressures.swapped", "supply.pressure.drift=2e4",
    ])  # fmt: skip
    shown_a, shown_b, shown_supply = faults.pressures(TIME, a, b, supply)
    np.testing.assert_allclose(shown_a[:, FITTED] - a[:, FITTED], offset * ~BEFORE, atol=1e-6)
    np.testing.assert_array_equal(shown_b[:, FITTED], b[:, FITTED])
    np.testing.assert_allclose(shown_b[:, 2], (1.0 + gain) * b[:, 2])
    np.testing.assert_array_equal(shown_a[:, 0], b[:, 0])
    np.testing.assert_array_equal(shown_b[:, 0], a[:, 0])
    np.testing.assert_allclose(shown_supply - supply, 2e4 * TIME, atol=1e-6)


def test_what_is_repaired_is_well_again(machine: Machine) -> None:
    faults = Faults(machine, [f"{JOINT}.encoder.jump", "telescope.encoder.jump"])
    faults.mend(f"{JOINT}.encoder")
    np.testing.assert_allclose(faults.positions(1.0, np.zeros(4)), [0.0, 0.0, 0.0, 0.02])
    faults.mend("all")
    np.testing.assert_array_equal(faults.positions(1.0, np.zeros(4)), np.zeros(4))
    with pytest.raises(ConfigurationError, match="is not faulty; faulty: none"):
        faults.mend(f"{JOINT}.encoder")


def test_every_kind_is_written_as_it_is_read(machine: Machine) -> None:
    for target, parts in parts_of(machine).items():
        for part in parts:
            for kind in KINDS[part]:
                fault = parse(f"{target}.{part}.{kind}@2.5", machine)
                assert parse(str(fault), machine) == fault


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("elbow.encoder.stuck", "there is no 'elbow'; there are slew"),
        ("slew.pressure_a.stuck", "slew has no 'pressure_a'; it has encoder, valve"),
        ("telescope.encoder.slow", "there are stuck, jump"),
        ("telescope.encoder", "write TARGET.PART.KIND"),
        ("telescope.encoder.stuck=1", "stuck has no size"),
        ("telescope.encoder.noise=-1", "at least 0"),
        ("telescope.encoder.jump=nan", "must be finite"),
        ("telescope.encoder.jump@-1", "not negative"),
        ("telescope.encoder.jump@soon", "write TARGET"),
    ],
)
def test_what_is_wrong_with_a_fault_is_said(machine: Machine, text: str, why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        parse(text, machine)


def test_a_person_pulls_a_plug(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    faults = Faults(machine, leaks=False)
    operator = Operator(machine.joint_names, faults)
    operator.obey(f"fault={JOINT}.encoder.jump=0.5\n")
    assert capsys.readouterr().out == f"fault: {JOINT}.encoder.jump=0.5\n"
    assert faults.positions(0.0, np.zeros(4))[COLUMN] == 0.5
    operator.obey("repaired=all")
    assert faults.positions(0.0, np.zeros(4))[COLUMN] == 0.0
    with pytest.raises(ConfigurationError, match="identified from a model"):
        operator.obey(f"fault={JOINT}.valve.leaking")
    with pytest.raises(RangeError, match="fault=TARGET"):
        operator.obey("broken=all")


@pytest.fixture(scope="module")
def motion(machine: Machine, simulated: SimulatedCrane, trajectory: PeriodicTrajectory) -> Motion:
    clearance = load_clearance(machine_file("clearance.yaml"))
    return plan(machine, trajectory, simulated.start, 1, clearance)


def recorded(
    machine: Machine, simulated: SimulatedCrane, motion: Motion, *faults: str
) -> SimulatedRecording:
    plant = Plant(simulated, machine, motion.start, (), 100.0)
    timed = Faults(machine, faults, zero=100.0)
    sensors = Sensors(simulated.sensors, machine, 1, (), timed)
    return record(motion, plant, sensors, load_gains(machine_file("controller.yaml"), machine))


def test_a_recording_is_as_ever_until_a_fault_begins(
    machine: Machine, simulated: SimulatedCrane, motion: Motion
) -> None:
    well = recorded(machine, simulated, motion)
    ill = recorded(
        machine, simulated, motion, f"{JOINT}.encoder.stuck@15", "supply.pressure.stuck@12",
        "telescope.valve.leaking@10",
    )  # fmt: skip
    time = well.time - 100.0
    np.testing.assert_array_equal(ill.position[time < 10.0], well.position[time < 10.0])
    np.testing.assert_array_equal(
        ill.pressures.supply[time < 10.0], well.pressures.supply[time < 10.0]
    )
    assert np.ptp(ill.position[time > 15.0, COLUMN]) == 0.0
    assert np.ptp(ill.truth.position[time > 15.0, COLUMN]) > 0.05, "the machine goes on"
    assert np.ptp(ill.pressures.supply[time > 12.0]) == 0.0
    # With the piston leaking, the same command moves the telescope less, and (36) commands more.
    inside = (time > 10.0) & (time < 15.0)
    more = np.abs(ill.command[inside, 3]).sum() - np.abs(well.command[inside, 3]).sum()
    assert more > 0.0
