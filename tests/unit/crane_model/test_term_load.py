"""Tilt, payload, hoses, slewing and a swinging load, against Pinocchio and numeric derivatives."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.lagrangian import gravity_vector
from unit.crane_model.pinocchio_crane import THETA_20, planar_crane, random_bodies, spatial_crane
from unit.crane_model.test_term_registry import SETTING, random_record

from crane_model import Machine, Record, tip_jacobian, tip_position
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.terms.friction import WeightFriction
from crane_model.terms.gravity_and_load import (
    AxisReach,
    BaseTilt,
    BoomDirections,
    HoseMass,
    Payload,
    SlewCoupling,
)
from crane_model.terms.term import Load

RECORD = random_record()


def forces(model: pin.Model, *motion: np.ndarray) -> np.ndarray:
    """Inverse dynamics of Pinocchio, sample by sample."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *sample) for sample in zip(*motion, strict=True)])


def point(mass: float, place: list[float]) -> pin.Inertia:
    return pin.Inertia(mass, np.array(place), np.zeros((3, 3)))


def test_payload_is_a_point_mass_at_the_tip_of_pinocchios_crane() -> None:
    crane = planar_crane(random_bodies(5))
    loaded = crane.copy()
    tip = crane.frames[crane.getFrameId("tip")]
    loaded.appendBodyToJoint(tip.parentJoint, point(1.0, [0.0, 0.0, 0.0]), tip.placement)
    motion = RECORD.position, RECORD.velocity, RECORD.acceleration
    more = forces(loaded, *motion) - forces(crane, *motion)
    columns = Payload().columns(RECORD, SETTING)
    np.testing.assert_allclose(columns[:, :, 0], more, rtol=1e-9, atol=1e-9)


def test_each_load_is_carried_in_its_runs_only() -> None:
    always = Payload().columns(RECORD, SETTING)[:, :, 0]
    one = Payload(loads=(Load(runs=(1,)),)).columns(RECORD, SETTING)
    assert one.shape == (len(RECORD), 3, 1)
    assert not one[RECORD.run == 0].any()
    np.testing.assert_array_equal(one[RECORD.run == 1, :, 0], always[RECORD.run == 1])
    two = Payload(loads=(Load(runs=(1,)), Load(runs=(0,))))
    columns = two.columns(RECORD, SETTING)
    np.testing.assert_array_equal(columns[:, :, 0], one[:, :, 0])
    np.testing.assert_array_equal(columns.sum(axis=2), always)
    assert [p.name for p in two.parameters(SETTING)] == ["m_payload_1", "m_payload_2"]
    assert [p.minimum for p in two.parameters(SETTING)] == [0.0, 0.0]  # beyond the lightest


def test_a_record_without_runs_carries_no_load_of_single_runs() -> None:
    """As all that `identify` and the online estimator ask: run 0 was one of another session."""
    loads = Payload(loads=(Load(runs=(0,)),))
    unnumbered = replace(RECORD, run=None)
    assert not loads.columns(unnumbered, SETTING).any()
    assert Payload().columns(unnumbered, SETTING).any()


def test_a_run_carries_one_load() -> None:
    with pytest.raises(ValueError, match="run 1 is in two loads"):
        Payload(loads=(Load(runs=(0, 1)), Load(runs=(1,))))


def test_tilt_is_mass_moments_turned_and_the_weight_of_the_telescope(geometry: Geometry) -> None:
    """Gravity of a tilted crane: what no mass moment takes up is the column, times the mass."""
    bodies, tilt = random_bodies(6), 1e-5
    still = np.zeros_like(RECORD.position)
    level, leaning = planar_crane(bodies), planar_crane(bodies)
    # seen from a base whose booms are raised by the tilt; they move in x-z
    leaning.gravity.linear = 9.81 * np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
    change = (
        forces(leaning, RECORD.position, still, still)
        - forces(level, RECORD.position, still, still)
    ) / tilt
    moments = lagrangian_regressor(geometry, RECORD.position, still, still)[:, :, [1, 2, 4, 5]]
    columns = np.concatenate([moments, BaseTilt().columns(RECORD, SETTING)], axis=2)
    values, *_ = np.linalg.lstsq(columns.reshape(-1, 5), change.ravel(), rcond=None)
    assert values[-1] == pytest.approx(bodies["TG"].mass, rel=1e-4)
    np.testing.assert_allclose(columns @ values, change, rtol=1e-3, atol=1e-2)
    without = np.linalg.lstsq(moments.reshape(-1, 4), change.ravel(), rcond=None)[0]
    assert np.abs(moments @ without - change).max() > 100.0  # the column is needed


def test_slew_coupling_is_that_of_pinocchios_spatial_crane() -> None:
    """A boom whose mass lies on its line, and a mass on the telescope's axis, slewing and not."""
    reach, boom_mass, boom_place, outer_mass = 1.1, 80.0, 0.7, 120.0
    along = [boom_place * np.cos(THETA_20), boom_place * np.sin(THETA_20), 0.0]
    crane = spatial_crane({"FL": point(boom_mass, along), "TG": point(outer_mass, [0, 0, reach])})
    spin = RECORD.slew_velocity[:, None]
    q, v, a = (
        np.hstack([0 * spin, each])
        for each in (RECORD.position, RECORD.velocity, RECORD.acceleration)
    )
    turning = np.hstack([spin, RECORD.velocity])
    more = (forces(crane, q, turning, a) - forces(crane, q, v, a))[:, 1:]
    columns = SlewCoupling(reach=reach).columns(RECORD, SETTING)
    expected = columns @ [boom_mass * boom_place**2, outer_mass]
    np.testing.assert_allclose(expected, more, rtol=1e-9, atol=1e-9)


def test_hose_mass_is_the_slope_of_its_potential_energy(machine: Machine) -> None:
    def energy(q: np.ndarray) -> np.ndarray:
        record = replace(RECORD, position=q)
        _, psi, extension = BoomDirections.of(machine, record)
        return machine.gravity * extension**2 / 2.0 * np.sin(psi)

    column = HoseMass().columns(RECORD, SETTING)[:, :, 0]
    for j in range(3):
        step = 1e-6 * np.eye(3)[j]
        slope = (energy(RECORD.position + step) - energy(RECORD.position - step)) / 2e-6
        np.testing.assert_allclose(column[:, j], slope, atol=1e-6)


def test_reach_and_its_acceleration_are_those_of_the_boom_tip(machine: Machine) -> None:
    """x of (2) at slew 0, its Jacobian, and its second difference along a smooth motion."""
    length = machine.as_planar().telescope_length
    h, time = 1e-4, np.linspace(0.0, 3.0, 50)

    def place(t: np.ndarray) -> np.ndarray:
        return np.stack([0.4 + 0.3 * np.sin(t), -1 + 0.5 * np.cos(2 * t), 0.5 + 0.3 * t], axis=1)

    q, before, after = place(time), place(time - h), place(time + h)
    v, a = (after - before) / (2 * h), (after - 2 * q + before) / h**2
    reach = AxisReach.of(machine, length, Record(PLANAR_JOINTS, time, q, v, a))

    def distance(q: np.ndarray) -> np.ndarray:
        return tip_position(machine, np.insert(q, 0, 0.0, axis=1))[:, 0]

    np.testing.assert_allclose(reach.distance, distance(q), atol=1e-12)
    jacobian = tip_jacobian(machine, np.insert(q, 0, 0.0, axis=1))[:, 0, 1:]
    np.testing.assert_allclose(reach.gradient, jacobian, atol=1e-12)
    acceleration = (distance(after) - 2 * distance(q) + distance(before)) / h**2
    along = np.einsum("nj,nj->n", reach.gradient, a) + reach.bias
    np.testing.assert_allclose(along, acceleration, atol=1e-5)


@pytest.mark.parametrize("j", range(3))
def test_friction_by_the_weight_knows_no_acceleration(j: int) -> None:
    """It is that of gravity alone, which the model of the controllers has in closed form."""
    machine = SETTING.machine
    assert machine is not None
    geometry, bodies = Geometry.of(machine), np.random.default_rng(4).uniform(100.0, 1e3, 8)
    nine = np.append(
        bodies, geometry.telescope_offset * bodies[6]
    )  # all of the telescope's mass on its axis
    term = WeightFriction(joint=PLANAR_JOINTS[j], bodies=tuple(bodies))
    columns = term.columns(RECORD, SETTING)
    weight = gravity_vector(geometry, nine, RECORD.position)[:, j]
    expected = np.sign(RECORD.velocity[:, j]) * np.abs(weight)
    np.testing.assert_allclose(columns[:, j, 0], expected, rtol=1e-9)
    assert not np.delete(columns, j, axis=1).any()
    faster = replace(RECORD, velocity=2.0 * RECORD.velocity, acceleration=9.0 * RECORD.acceleration)
    np.testing.assert_array_equal(term.columns(faster, SETTING), columns)
