"""Injected faults of sensors, and injected effects in the flow."""

from collections.abc import Sequence

import numpy as np
import pytest
from unit.crane_sim.injected_machine import Rig, effect_of, rig

from crane_model import Machine, load_machine
from crane_sim import SimulatedCrane
from crane_sim.effects.flow import leak, meter, note_softness, softness
from crane_sim.effects.form import InjectedForm, SensorFault
from crane_sim.effects.sensing import faults
from crane_sim.parts.cylinders import opening

JOINTS = load_machine().joint_names

JOINT, COLUMN = "outer_boom", 2
TIME = np.sort(0.005 * np.arange(400) + np.random.default_rng(1).uniform(-1e-4, 1e-4, 400))
A, B = (
    mean + 5e5 * np.sin(TIME[:, None] * np.arange(1.0, 5.0) + shift)
    for mean, shift in ((6e6, 0.0), (4e6, 1.0))
)


def fault(effect: InjectedForm) -> SensorFault:
    (made,) = faults([effect], load_machine())
    return made


def shown(effect: InjectedForm) -> tuple[np.ndarray, np.ndarray]:
    """What the transducers of the joint show; the others show what is."""
    seen = fault(effect).pressures(TIME, A, B)
    for got, true in zip(seen, (A, B), strict=True):
        np.testing.assert_array_equal(
            np.delete(got, COLUMN, axis=1), np.delete(true, COLUMN, axis=1)
        )
    return seen[0][:, COLUMN], seen[1][:, COLUMN]


def test_zeros_gains_and_bent_characteristics() -> None:
    """By their formulas; the true pressures stay as they are."""
    true_a, true_b = A[:, COLUMN].copy(), B[:, COLUMN].copy()
    warming = 1.0 - 0.1 * (1.0 - np.exp(-TIME / 40.0))
    phase = 2 * np.pi * 3.0 * TIME
    beat = 4e4 * (1 + 0.3 * np.sin(0.9 * TIME))
    cases: Sequence[tuple[InjectedForm, np.ndarray, np.ndarray]] = (
        (effect_of("pressure_offset", JOINT, 1e5, 0.1, 40.0), true_a + 1e5 * warming, true_b),
        (effect_of("pressure_gain", JOINT, 0.03), 1.03 * true_a, 1.03 * true_b),
        (effect_of("chamber_gain", JOINT, 0.03), true_a, 1.03 * true_b),
        (effect_of("crosstalk", JOINT, 0.02), true_a + 0.02 * B[:, 3], true_b),
        (
            effect_of("transducer_nonlinearity", JOINT, 1e5, 2e7),
            true_a + 4e5 * true_a / 2e7 * (1 - true_a / 2e7),
            true_b,
        ),
        (
            effect_of("pressure_ripple", JOINT, 4e4, 3.0),
            true_a + beat * np.sin(phase),
            true_b + 0.4 * beat * np.sin(phase - 1.0),
        ),
    )
    for effect, wanted_a, wanted_b in cases:
        got_a, got_b = shown(effect)
        np.testing.assert_allclose(got_a, wanted_a, err_msg=effect.form.effect)
        np.testing.assert_allclose(got_b, wanted_b, err_msg=effect.form.effect)
        np.testing.assert_array_equal(A[:, COLUMN], true_a)


@pytest.mark.parametrize("form", ["delay", "lag"])
def test_pressures_come_late(form: str) -> None:
    """A ramp is shown as it was a delay ago, by either form, once it has gone on for a while."""
    seen = fault(effect_of("time_skew", JOINT, 0.02, form=form))
    ramp = np.tile(5e6 + 1e6 * TIME[:, None], 4)
    late = seen.pressures(TIME, ramp, ramp)[0][:, COLUMN]
    np.testing.assert_allclose(late[50:], 5e6 + 1e6 * (TIME[50:] - 0.02), atol=200.0)


def test_encoders() -> None:
    """Turned, and off its centre; one pose or many."""
    poses = np.random.default_rng(2).normal(size=(7, 4))
    turned = fault(effect_of("encoder_offset", JOINT, 0.01))
    np.testing.assert_allclose(turned.positions(poses) - poses, 0.01 * np.eye(4)[[COLUMN] * 7])
    np.testing.assert_allclose(turned.positions(poses[0]), turned.positions(poses)[0])
    disk = fault(effect_of("encoder_eccentricity", JOINT, 0.01, 8.0, 0.5))
    error = (disk.positions(poses) - poses)[:, COLUMN]
    np.testing.assert_allclose(error, 0.01 * np.sin(8.0 * poses[:, COLUMN] + 0.5))


def spool(injected: Rig, position: float) -> float:
    """Metering opening of the joint's valve."""
    injected.state.actuators[COLUMN]["spool"] = position
    return float(meter(injected.injected, injected.constants, injected.state, COLUMN))


def test_valves(machine: Machine, simulated: SimulatedCrane) -> None:
    """More overlap, two gains, edges that trail; what they change in the flow is noted."""
    zone = simulated.valves["outer_boom"].dead_band
    overlap = rig(simulated, machine, effect_of("valve_dead_band", JOINT, 0.1, 0.004))
    gains = rig(simulated, machine, effect_of("valve_asymmetry", JOINT, 0.2, 0.004))
    for position in (-0.8, -0.3, 0.3, 0.8):
        x = opening(position, zone)
        assert spool(overlap, position) == pytest.approx(x - 0.1 * np.sign(x), abs=2e-3)
        assert spool(gains, position) == pytest.approx(x * (1 + 0.2 * np.sign(x)))
        actuator, valve = gains.state.actuators[COLUMN], gains.constants.valves[COLUMN]
        tank = machine.hydraulics.tank_pressure
        drop = (17e6 if x > 0 else tank) - actuator["p_a"]
        # more flows in at the one edge, less flows out at the other
        more = valve["supply_a"] * 0.2 * abs(x) * np.sqrt(abs(drop))
        assert gains.injected.flow[0, COLUMN] == pytest.approx(more, rel=2e-3)
    assert abs(spool(overlap, 0.1)) < 0.05 * opening(0.1, zone) + 2e-3

    play = rig(simulated, machine, effect_of("valve_hysteresis", JOINT, 0.06))
    assert spool(play, 0.5) == pytest.approx(opening(0.47, zone))
    assert spool(play, 0.46) == pytest.approx(opening(0.47, zone))
    assert spool(play, 0.3) == pytest.approx(opening(0.33, zone))


def test_leakage_and_softness(machine: Machine, simulated: SimulatedCrane) -> None:
    """An orifice past the piston; hose walls and air that give way with the pressure."""
    injected = rig(simulated, machine, effect_of("internal_leakage", JOINT, 1e-9))
    actuator = injected.state.actuators[COLUMN]
    drop = float(actuator["p_a"] - actuator["p_b"])
    conductance = leak(injected.injected, injected.constants, injected.state, COLUMN)
    flow = (conductance - simulated.cylinders["outer_boom"].leakage) * drop
    assert flow == pytest.approx(1e-9 * np.sqrt(drop), rel=0.06)  # laminar below 5 bar
    assert injected.injected.flow[0, COLUMN] == pytest.approx(-flow)

    beta, pressure = simulated.oil.bulk_modulus, 3e6
    wall = rig(simulated, machine, effect_of("oil_compressibility", JOINT, 0.8, 2e7))
    got = softness(wall.injected, wall.constants, COLUMN, pressure)
    assert got == pytest.approx(1 + 0.8 / (1 + pressure / 2e7))
    note_softness(wall.injected, wall.constants, COLUMN, pressure, 1e-3, 1e6)
    assert wall.injected.flow[0, COLUMN] == pytest.approx((got - 1) * 1e-3 / beta * 1e6)

    # a share of the volume that is gas: V = V_0 p_0/p, and beta_gas = -V dp/dV = p for it
    air = rig(simulated, machine, effect_of("air_in_oil", JOINT, 0.02))
    absolute = pressure + 1.013e5
    compliance = 1 / beta + 0.02 * 1.013e5 / absolute / absolute
    got = softness(air.injected, air.constants, COLUMN, pressure)
    assert got == pytest.approx(compliance * beta)
    others = [softness(air.injected, air.constants, i, pressure) for i in range(len(JOINTS))]
    assert others == [1.0, 1.0, got, 1.0]
