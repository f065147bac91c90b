"""Valves and chambers: the equations, the section of the model file, the crane that they move."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from crane_model import ConfigurationError, Model, Record, load_model, save_model
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.hydraulics.simulation import CraneState, circuit_of, simulate_openings, substeps
from crane_model.hydraulics.stepping import openings, spool_course, trailing
from crane_model.machine_files import machine_file

GAIN = 3e-7
VALVE = {
    "dead_band_a": 0.05,
    "dead_band_b": 0.06,
    "hysteresis": 0.01,
    "lag": 0.02,
    "natural_frequency": 150.0,
    "damping_ratio": 0.8,
    **dict.fromkeys(("supply_a", "a_tank", "supply_b", "b_tank"), GAIN),
}
CHAMBERS = {
    "bulk_modulus": 1.2e9,
    "dead_volume_a": 1e-4,
    "dead_volume_b": 1.5e-4,
    "leakage": 0.0,
}
THETA = np.array(
    [480.0, 366.0, 18.0, 446.0, 263.0, 20.0, 150.0, 223.0]
    + [800.0, 180.0, 9000.0, -1600.0, 520.0, -110.0, 3200.0, 620.0, 720.0, 120.0, 1500.0, 330.0]
)
PERIOD = 0.005


def hydraulics(**changed: float) -> HydraulicValues:
    def measured(kind: type[ValveValues] | type[ChamberValues], values: dict[str, float]) -> dict:
        given = {name: changed.get(name, value) for name, value in values.items()}
        return {
            name: Measured(value=value, std_dev=abs(value) / 100.0, unit=kind.units[name])
            for name, value in given.items()
        }

    one = JointHydraulics(
        valve=ValveValues(**measured(ValveValues, VALVE)),
        chambers=ChamberValues(**measured(ChamberValues, CHAMBERS)),
        unexplained=0.001,
        undetermined={"leakage": "a load held"},
    )
    joints = dict.fromkeys(("inner_boom", "outer_boom", "telescope"), one)
    return HydraulicValues(provenance="by hand", joints=joints)


def crane(**changed: float) -> Model:
    model = load_model(machine_file("model.yaml"))
    estimated = model.with_estimate(THETA, np.ones_like(THETA), "by hand")
    return replace(estimated, hydraulics=hydraulics(**changed))


def carried(model: Model) -> CraneState:
    """At rest, with pressures that carry gravity."""
    assert model.machine is not None
    q, still = np.array([[0.35, -1.5, 0.6]]), np.zeros((1, 3))
    record = Record(model.joints, np.zeros(1), q, still, still)
    force = cylinder_forces_from_generalized(model.machine, q, model.gravity(record), model.joints)
    areas = [model.machine.cylinders[joint] for joint in model.joints]
    area_a, area_b = (np.array([getattr(a, n) for a in areas]) for n in ("area_a", "area_b"))
    p_b = np.full((1, 3), 5e6)
    return CraneState(q, still, (force + area_b * p_b) / area_a, p_b)


def test_a_spool_follows_as_its_differential_equation_says() -> None:
    stamps, commands = np.array([0.0, 0.013, 0.021, 0.05]), np.array([0.0, 0.3, -0.2, 0.1])
    times = np.linspace(0.0, 0.12, 400)
    for damping in (0.4, 1.0, 1.7):
        found = spool_course(stamps, commands, times, 150.0, damping)

        def slope(t: float, y: np.ndarray, damping: float = damping) -> list[float]:
            u = commands[np.searchsorted(stamps, t, side="right") - 1]
            return [y[1], 150.0**2 * (u - y[0]) - 2.0 * damping * 150.0 * y[1]]

        exact = solve_ivp(slope, (0.0, 0.12), [0.0, 0.0], t_eval=times, max_step=2e-4, rtol=1e-8)
        np.testing.assert_allclose(found, exact.y[0], atol=2e-4)


def test_edges_trail_the_spool_and_open_beyond_the_dead_bands() -> None:
    there_and_back = np.array([0.0, 0.2, 0.195, 0.15, -0.3])
    z = trailing(there_and_back, 0.02)
    np.testing.assert_allclose(z, [0.0, 0.19, 0.19, 0.16, -0.29])
    o = openings(z, 0.05, 0.1)
    np.testing.assert_allclose(o, [0.0, 0.14 / 0.95, 0.14 / 0.95, 0.11 / 0.95, -0.19 / 0.9])


def test_a_model_file_keeps_the_hydraulics(tmp_path: Path) -> None:
    model = crane()
    save_model(tmp_path / "model.yaml", model)
    assert load_model(tmp_path / "model.yaml").hydraulics == model.hydraulics


@pytest.mark.parametrize(
    ("wrong", "right", "told"),
    [
        ("unit: Pa\n", "unit: bar\n", "bulk_modulus: its unit must be 'Pa', got 'bar'"),
        ("value: 0.05\n", "value: -0.05\n", "dead_band_a: must be 0 to 0.9"),
        ("    outer_boom:\n      valve", "    outer_bom:\n      valve", "outer_bom: no joint of"),
    ],
)
def test_wrong_hydraulics_are_named(tmp_path: Path, wrong: str, right: str, told: str) -> None:
    save_model(tmp_path / "model.yaml", crane())
    text = (tmp_path / "model.yaml").read_text()
    assert wrong in text
    (tmp_path / "model.yaml").write_text(text.replace(wrong, right, 1))
    with pytest.raises(ConfigurationError, match=told):
        load_model(tmp_path / "model.yaml")


def test_a_model_without_hydraulics_says_what_is_missing() -> None:
    model = replace(crane(), hydraulics=None)
    with pytest.raises(ConfigurationError, match="holds no hydraulics; identify them"):
        circuit_of(model)
    known = hydraulics()
    lost = {"joints": {}, "unknown": {"inner_boom": "it never moved"}}
    partly = known.model_copy(update=lost)
    with pytest.raises(ConfigurationError, match="inner_boom are not identified: it never moved"):
        circuit_of(replace(model, hydraulics=partly))


def test_a_crane_with_closed_valves_stays() -> None:
    model = crane()
    closed = np.zeros((200, substeps(PERIOD), 1, 3))
    position, velocity = simulate_openings(model, carried(model), closed, PERIOD)
    np.testing.assert_allclose(position[-1], position[0], atol=1e-6)
    assert not velocity[-1].any()


def test_a_piston_takes_in_what_the_valve_lets_through() -> None:
    """The telescope at constant opening: both edges in series, the load from its equilibrium."""
    model = crane()
    opened = np.zeros((400, substeps(PERIOD), 1, 3))
    opened[..., 2] = 0.1
    position, velocity = simulate_openings(model, carried(model), opened, PERIOD)
    assert model.machine is not None
    cylinder, circuit = model.machine.cylinders["telescope"], circuit_of(model)
    # p_A from Q_A / A_A = Q_B / A_B and the force that gravity and friction at that speed need
    still = np.zeros((1, 3))
    moving = Record(model.joints, np.zeros(1), position[-1], velocity[-1], still)
    force = float(model.predict(moving)[0, 2])
    area_a, area_b = cylinder.area_a, cylinder.area_b
    drop = area_a * circuit.supply_pressure - area_b * circuit.tank_pressure - force
    speed = GAIN * 0.1 * np.sqrt(drop / (area_a**3 + area_b**3))
    assert velocity[-1, 0, 2] == pytest.approx(speed, rel=2e-3)
    np.testing.assert_allclose(position[-1, 0, :2], position[0, 0, :2], atol=3e-4)
