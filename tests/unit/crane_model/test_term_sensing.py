"""What wrong sensors do to the measured force, worked out anew and compared with the columns."""

from dataclasses import replace

import numpy as np
import pytest
from laboratory_crane import LINKAGES, PLANAR_JOINTS, with_linkage
from unit.crane_model.test_term_registry import SETTING, random_record

from crane_model import ConfigurationError, Machine, Record, generalized_forces
from crane_model.cylinders import lever_arm
from crane_model.terms import REGISTRY
from crane_model.terms.drives import ActuatorInertia
from crane_model.terms.force_scale import ForceScale, LinkageScale, PressureGain
from crane_model.terms.gravity_and_load import BaseTilt
from crane_model.terms.nonparametric import NonparametricLoadFriction
from crane_model.terms.rigid_body import PlanarRigidBody
from crane_model.terms.sensing import (
    ChamberAGain,
    ChamberGain,
    EncoderOffset,
    PressureOffset,
    TimeSkew,
    VelocityLag,
)

INERTIAL = (480.0, 370.0, 18.0, 450.0, 260.0, 20.0, 150.0, 220.0)


@pytest.fixture(scope="module")
def record(machine: Machine) -> Record:
    """Its force is that of its pressures (27)."""
    record = random_record()
    pressures = record.pressure_a, record.pressure_b
    return replace(
        record, force=generalized_forces(machine, record.position, *pressures, record.joints)
    )


def changed_force(machine: Machine, record: Record, j: int, a: float, b: float, gain: float):
    """What is measured if A reads a [Pa] too much, B times 1 + b, and both times 1 + gain."""
    p_a, p_b = record.pressure_a.copy(), record.pressure_b.copy()
    p_a[:, j] = (1.0 + gain) * p_a[:, j] + a
    p_b[:, j] = (1.0 + gain) * (1.0 + b) * p_b[:, j]
    return generalized_forces(machine, record.position, p_a, p_b, record.joints)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_offset_and_gain_of_transducers(machine: Machine, record: Record, joint: str) -> None:
    """The columns are taken from true pressures here; on data, from measured ones."""
    j = PLANAR_JOINTS.index(joint)
    for term, value, change in (
        (PressureOffset(joint=joint), 1e5, (1e5, 0.0, 0.0)),
        (ChamberGain(joint=joint), 0.03, (0.0, 0.03, 0.0)),
        (PressureGain(joint=joint), 0.02, (0.0, 0.0, 0.02)),
    ):
        measured = changed_force(machine, record, j, *change)
        error = value * term.columns(record, SETTING)[:, :, 0]
        np.testing.assert_allclose(error, measured - record.force, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_the_gain_of_chamber_a_is_of_the_force_that_the_bodies_ask_for(
    machine: Machine, joint: str
) -> None:
    """Chamber A carries that force, and what chamber B has against it."""
    record, j = random_record(), PLANAR_JOINTS.index(joint)
    true = PlanarRigidBody().columns(record, SETTING) @ INERTIAL
    area = machine.cylinders[joint]
    arm = lever_arm(machine, joint, record.position[:, j])
    assert record.pressure_a is not None and record.pressure_b is not None
    p_a = record.pressure_a.copy()
    p_a[:, j] = (true[:, j] / arm + area.area_b * record.pressure_b[:, j]) / area.area_a
    both = (p_a, record.pressure_b)
    force = generalized_forces(machine, record.position, *both, record.joints)
    p_a = p_a.copy()
    p_a[:, j] *= 1.03
    measured = generalized_forces(machine, record.position, p_a, record.pressure_b, record.joints)
    column = ChamberAGain(joint=joint, bodies=INERTIAL).columns(record, SETTING)[:, :, 0]
    np.testing.assert_allclose(0.03 * column, measured - force, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("joint", LINKAGES)
def test_a_linkage_that_is_larger_than_in_its_file(machine: Machine, joint: str) -> None:
    """Its cylinder carries the bodies by its own lever arm; the file's makes the torque of that."""
    record, larger, j = random_record(), 1.03, PLANAR_JOINTS.index(joint)
    true = PlanarRigidBody().columns(record, SETTING) @ INERTIAL
    q = record.position[:, j]
    own = lever_arm(with_linkage(machine, joint, larger), joint, q)
    measured = true.copy()
    measured[:, j] *= lever_arm(machine, joint, q) / own
    scale = 1.0 - 1.0 / larger
    column = LinkageScale(joint=joint, bodies=INERTIAL).columns(record, SETTING)[:, :, 0]
    np.testing.assert_allclose(scale * column, measured - true, rtol=1e-9, atol=1e-6)
    seen = replace(record, force=measured)
    column = LinkageScale(joint=joint).columns(seen, SETTING)[:, :, 0]  # by the measured force
    np.testing.assert_allclose((larger - 1.0) * column, measured - true, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("term", [LinkageScale, PressureGain])
def test_scales_of_all_joints_alike_are_a_scale_of_the_masses(
    machine: Machine, term: type[ForceScale]
) -> None:
    """Up to the joints that have none."""
    record = random_record()
    body = PlanarRigidBody().columns(record, SETTING)
    joints = [joint for joint in PLANAR_JOINTS if term is PressureGain or joint in LINKAGES]
    total = sum(
        term(joint=joint, bodies=INERTIAL).columns(record, SETTING)[:, :, 0] for joint in joints
    )
    values = np.linalg.lstsq(body.reshape(-1, 8), total.ravel(), rcond=None)[0]
    same = np.allclose((body @ values).ravel(), total.ravel(), atol=1e-6)
    assert same is (term is PressureGain)


@pytest.mark.parametrize("kind", NonparametricLoadFriction.holds)
def test_a_shape_over_the_measured_force_holds_its_scale(record: Record, kind: str) -> None:
    """Beside Coulomb friction, which is what a line has at both ends of the knots."""
    moving = replace(record, direction_known=np.where(record.velocity < 0.0, -1.0, 1.0))
    drawn = NonparametricLoadFriction(joint="inner_boom", knots=tuple(np.linspace(-1e5, 1e5, 11)))
    ends = np.stack([np.ones(len(record)), moving.direction[:, 0]], axis=1)
    columns = np.concatenate([drawn.columns(moving, SETTING)[:, 0], ends], axis=1)
    scale = REGISTRY[kind](joint="inner_boom").columns(moving, SETTING)[:, 0, 0]
    left = scale - columns @ np.linalg.lstsq(columns, scale, rcond=None)[0]
    kept = np.linalg.norm(left) / np.linalg.norm(scale)
    assert kept < 1e-9


def test_a_cylinder_that_turns_nothing_has_no_linkage() -> None:
    with pytest.raises(ConfigurationError, match="'telescope' turns nothing"):
        LinkageScale(joint="telescope").parameters(SETTING)


@pytest.mark.parametrize("joint", ["inner_boom", "outer_boom"])
def test_encoder_offset_changes_the_torque_and_what_the_bodies_ask_for(
    machine: Machine, record: Record, joint: str
) -> None:
    """One angle changes both."""
    offset = 1e-6
    wrong = record.position.copy()
    wrong[:, PLANAR_JOINTS.index(joint)] += offset
    measured = generalized_forces(
        machine, wrong, record.pressure_a, record.pressure_b, record.joints
    )
    true, predicted = (
        PlanarRigidBody().columns(replace(record, position=q), SETTING) @ INERTIAL
        for q in (record.position, wrong)
    )
    error = ((measured - predicted) - (record.force - true)) / offset
    columns = EncoderOffset(joint=joint, bodies=INERTIAL).columns(record, SETTING)[:, :, 0]
    np.testing.assert_allclose(columns, error, rtol=1e-3, atol=0.05)


def test_a_tilt_is_not_made_of_zeros_of_encoders(record: Record) -> None:
    """Of both together, beside all that the rigid body takes up, while the cylinders carry it."""
    body = PlanarRigidBody().columns(record.at_rest(), SETTING)
    still = replace(record.at_rest(), force=body @ INERTIAL)
    zeros = [
        EncoderOffset(joint=joint, bodies=INERTIAL).columns(still, SETTING)
        for joint in ("inner_boom", "outer_boom")
    ]
    tilt = BaseTilt().columns(still, SETTING).ravel()

    def left(*beside: np.ndarray) -> float:
        columns = np.concatenate([body, *beside], axis=2).reshape(len(tilt), -1)
        values = np.linalg.lstsq(columns, tilt)[0]
        return float(np.linalg.norm(tilt - columns @ values) / np.linalg.norm(tilt))

    assert left(*zeros) > 0.25 * left() > 0.1  # with a free mass: 0


def test_delay_of_pressures_moves_the_force_along_its_rate(machine: Machine) -> None:
    """Two runs, between which the force jumps; the lever arm is that of the instant."""
    delay, half = 2e-3, 300
    time = np.tile(np.arange(half) * 0.005, 2)
    run = np.repeat([0, 1], half)
    q = np.stack([0.4 + 0.2 * np.sin(time), -1.2 + 0 * time, 0.5 + 0 * time], axis=1)

    def force(t: np.ndarray) -> np.ndarray:
        cylinder = 2e4 * np.sin(3.0 * t) + 5e3 * run
        tau = np.zeros((2 * half, 3))
        tau[:, 0] = lever_arm(machine, "inner_boom", q[:, 0]) * cylinder
        return tau

    still = np.zeros_like(q)
    true = Record(PLANAR_JOINTS, time, q, still, still, run=run, force=force(time))
    column = TimeSkew(joint="inner_boom").columns(true, SETTING)[:, :, 0]
    error = force(time - delay) - force(time)
    inner = np.tile(np.arange(half) % half, 2)
    inside = (inner > 0) & (inner < half - 1)
    np.testing.assert_allclose(
        delay * column[inside], error[inside], atol=0.02 * np.abs(error).max()
    )
    ends = np.abs(delay * column[~inside] - error[~inside]).max()
    assert ends < 0.1 * np.abs(error).max()  # differences do not reach into the other run
    rate = np.ones_like(q)
    known = TimeSkew(joint="inner_boom").columns(replace(true, force_rate=rate), SETTING)
    assert (known[:, 0, 0] == -1.0).all()


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_inertia_of_the_actuator_is_the_lagrangian_of_its_piston(
    machine: Machine, joint: str
) -> None:
    """d/dt (dT/dq') - dT/dq of T = x'^2/2, by differences."""
    j, h = PLANAR_JOINTS.index(joint), 1e-5
    record = random_record()
    q, v, a = (each[:, j] for each in (record.position, record.velocity, record.acceleration))

    def momentum(t: float) -> np.ndarray:
        return lever_arm(machine, joint, q + v * t + a * t**2 / 2) ** 2 * (v + a * t)

    def kinetic(q: np.ndarray) -> np.ndarray:
        return (lever_arm(machine, joint, q) * v) ** 2 / 2

    expected = (momentum(h) - momentum(-h)) / (2 * h) - (kinetic(q + h) - kinetic(q - h)) / (2 * h)
    column = ActuatorInertia(joint=joint).columns(record, SETTING)[:, j, 0]
    np.testing.assert_allclose(column, expected, rtol=1e-5, atol=1e-5)


def test_velocity_lag_takes_up_friction_at_a_misplaced_reversal() -> None:
    """Friction tanh(v/w) of the true velocity, seen at one that is late and too flat."""
    speed, late, flat = 0.02, 0.004, 0.03
    time = np.arange(0.0, 6.0, 0.005)
    v, a = np.sin(2.0 * time)[:, None] * 0.1, np.cos(2.0 * time)[:, None] * 0.2
    error = np.tanh(((1.0 + flat) * v + late * a) / speed) - np.tanh(v / speed)
    seen = Record(("outer_boom",), time, 0 * v, v, a)
    setting = SETTING._replace(units={"outer_boom": "rad"})
    columns = VelocityLag(joint="outer_boom", speed=speed).columns(seen, setting)[:, 0]
    values, *_ = np.linalg.lstsq(columns, error[:, 0], rcond=None)
    left = np.linalg.norm(error[:, 0] - columns @ values) / np.linalg.norm(error)
    assert left < 0.1
    np.testing.assert_allclose(values, [flat, late / speed], rtol=0.15)
