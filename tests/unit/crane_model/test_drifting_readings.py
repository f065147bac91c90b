"""Transducers that drift: what they do to the measured force, worked out anew."""

from dataclasses import replace

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.test_term_registry import SETTING, random_record
from unit.crane_model.test_term_sensing import INERTIAL

from crane_model import Machine, Record, generalized_forces
from crane_model.cylinders import lever_arm
from crane_model.terms.rigid_body import PlanarRigidBody
from crane_model.terms.sensing import ChamberGainDrift, PressureDrift

BEGIN = 1200.0  # s, after the first recording of the session


@pytest.fixture(scope="module")
def later() -> Record:
    record = random_record()
    return replace(record, time=record.time + BEGIN)


def measured(machine: Machine, record: Record, p_a: np.ndarray) -> np.ndarray:
    """The force (n, j) that is made of these readings of chamber A."""
    return generalized_forces(machine, record.position, p_a, record.pressure_b, record.joints)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_a_zero_drifts_by_so_much_a_second(machine: Machine, later: Record, joint: str) -> None:
    assert later.pressure_a is not None
    j, drifted = PLANAR_JOINTS.index(joint), later.pressure_a.copy()
    drifted[:, j] += 300.0 * later.time
    error = measured(machine, later, drifted) - measured(machine, later, later.pressure_a)
    column = PressureDrift(joint=joint).columns(later, SETTING)[:, :, 0]
    np.testing.assert_allclose(300.0 * column, error, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_a_gain_drifts_by_so_much_a_second(machine: Machine, later: Record, joint: str) -> None:
    """Chamber A carries the bodies, and what chamber B has against it."""
    true = PlanarRigidBody().columns(later, SETTING) @ INERTIAL
    assert later.pressure_a is not None and later.pressure_b is not None
    j, cylinder = PLANAR_JOINTS.index(joint), machine.cylinders[joint]
    arm = lever_arm(machine, joint, later.position[:, j])
    p_a = later.pressure_a.copy()
    p_a[:, j] = (true[:, j] / arm + cylinder.area_b * later.pressure_b[:, j]) / cylinder.area_a
    drifted = p_a.copy()
    drifted[:, j] *= 1.0 - 1e-4 * later.time
    error = measured(machine, later, drifted) - measured(machine, later, p_a)
    column = ChamberGainDrift(joint=joint, bodies=INERTIAL).columns(later, SETTING)[:, :, 0]
    np.testing.assert_allclose(-1e-4 * column, error, rtol=1e-9, atol=1e-6)
