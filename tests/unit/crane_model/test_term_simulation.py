"""Every candidate in forward simulation: the motion it makes needs the force that drove it."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.test_term_registry import CANDIDATES, OF_MOTORS, SETTING, example

from crane_model import Machine, Model, Record, generalized_forces, load_model, simulate
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file
from crane_model.terms import MemoryTerm, Term

PERIOD, STEPS = 0.004, 60
INERTIA = np.array([1000.0, 600.0, 20.0, 700.0, 350.0, 30.0, 150.0, 300.0])
FRICTION = np.array(
    [[800.0, 50.0, 900.0, 20.0], [300.0, -30.0, 400.0, 10.0], [250.0, 40.0, 1500.0, 30.0]]
).ravel()
HELD = {"coulomb", "coulomb_asymmetry", "offset", "viscous", "viscous_asymmetry"}  # by the base
FIXED = {  # kg m2, kg, kg, N m
    "boom_flexibility": 200.0,
    "swinging_load": 40.0,
    "actuator_inertia": 50.0,
    "stribeck": 200.0,
}


@pytest.fixture(scope="module")
def base() -> Model:
    model = load_model(machine_file("model.yaml"))
    return model.with_estimate(np.r_[INERTIA, FRICTION], np.zeros(20), "made up")


@pytest.fixture(scope="module")
def moved(base: Model, machine: Machine) -> Record:
    """A smooth motion without reversals, with everything that a term may ask for."""
    time = PERIOD * np.arange(STEPS)
    speed, rate = np.array([0.12, -0.3, 0.3]), np.array([9.0, 12.0, 7.0])
    phase = rate * time[:, None]
    q = np.array([0.2, -0.6, 1.4]) + speed * time[:, None] - 0.2 * speed / rate * np.cos(phase)
    v = speed * (1.0 + 0.2 * np.sin(phase))
    a = 0.2 * speed * rate * np.cos(phase)
    force = base.predict(Record(PLANAR_JOINTS, time, q, v, a))
    cylinder = cylinder_forces_from_generalized(machine, q, force, PLANAR_JOINTS)
    area_a, area_b = (
        np.array([getattr(machine.cylinders[joint], name) for joint in PLANAR_JOINTS])
        for name in ("area_a", "area_b")
    )
    pressure_b = 50e5 * np.ones_like(q)
    pressure_a = (cylinder + area_b * pressure_b) / area_a
    np.testing.assert_allclose(
        generalized_forces(machine, q, pressure_a, pressure_b, PLANAR_JOINTS), force
    )
    return Record(
        PLANAR_JOINTS,
        time,
        q,
        v,
        a,
        force=force,
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        slew_velocity=0.3 + 0.2 * np.sin(5.0 * time),
        temperature=30.0 + 4.0 * time,
    )


def extended(base: Model, term: Term, record: Record) -> Model:
    """By some percent of the force of each joint on which the term acts."""
    columns = term.columns(record, SETTING)
    size = np.sqrt((columns**2).mean(axis=0))
    force = np.sqrt((record.force**2).mean(axis=0))[:, None]
    share = 0.04 / size.shape[1]
    shares = np.where(size > 0.0, share * force / np.maximum(size, 1e-300), np.inf).min(axis=0)
    values = np.where(np.isfinite(shares), shares, 1.0)
    if term.type in FIXED:
        values[:] = FIXED[term.type]
    return Model("extended", base.setting, (*base.terms, term), np.r_[base.theta, values])


def middle(values: np.ndarray) -> np.ndarray:
    return (values[1:] + values[:-1]) / 2


@pytest.mark.parametrize("name", sorted(set(CANDIDATES) - HELD - OF_MOTORS))
def test_motion_under_a_candidate_needs_the_force_that_drove_it(
    base: Model, moved: Record, machine: Machine, name: str
) -> None:
    """Between instants, inverse dynamics of the simulated motion is the drive, if it is in it."""
    term = example(name)
    model = extended(base, term, moved)
    drive = cylinder_forces_from_generalized(machine, moved.position, moved.force, PLANAR_JOINTS)
    logged = ("pressure_a", "pressure_b", "slew_velocity", "temperature")
    beside = {signal: getattr(moved, signal)[:, None] for signal in logged}
    start = moved.position[:1], moved.velocity[:1]
    motion = simulate(model, *start, drive[:, None], PERIOD, 1, beside)
    q, v, force = motion.position[:, 0], motion.velocity[:, 0], motion.force[:, 0]
    assert np.isfinite(q).all()
    assert np.abs(q - moved.position).max() < 0.2
    seen = {signal: middle(getattr(moved, signal)) for signal in logged}
    time, acceleration = middle(moved.time), motion.acceleration[1:, 0]
    memory = {}
    if isinstance(term, MemoryTerm):
        still = np.zeros_like(q)
        whole = Record(PLANAR_JOINTS, moved.time, q, v, still, force=force)
        memory = {term: middle(term.trace(whole, SETTING))}
    record = Record(
        PLANAR_JOINTS,
        time,
        middle(q),
        middle(v),
        acceleration,
        force=middle(force),
        memory=memory,
        **seen,
    )
    slid = v[1:] * v[:-1] > 0.02**2  # at standstill any friction would do
    assert slid.mean() > 0.5

    def left(model: Model) -> float:
        error = (model.predict(record) - record.force) / np.sqrt((moved.force**2).mean(axis=0))
        return float(np.sqrt((error[slid] ** 2).mean()))

    without, with_it = left(base), left(model)
    assert with_it < 4e-3
    if without > 1e-3:  # the term acts in this motion
        assert with_it < 0.2 * without
