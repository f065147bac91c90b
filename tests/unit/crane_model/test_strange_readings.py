"""Readings that are not in proportion to their own pressure, worked out anew from (19)."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.test_term_registry import SETTING, random_record

from crane_model import ConfigurationError, Machine, generalized_forces
from crane_model.terms.sensing import (
    BentReading,
    CurvedReadingOfA,
    CurvedReadingOfB,
    OtherPressures,
)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_two_bent_transducers(machine: Machine, joint: str) -> None:
    record, j = random_record(), PLANAR_JOINTS.index(joint)
    p_a, p_b = record.pressure_a.copy(), record.pressure_b.copy()
    true = generalized_forces(machine, record.position, p_a, p_b, record.joints)
    p_a[:, j] *= 1.0 + 0.02 * p_a[:, j] / 1e7
    p_b[:, j] *= 1.0 - 0.03 * p_b[:, j] / 1e7
    measured = generalized_forces(machine, record.position, p_a, p_b, record.joints)
    error = BentReading(joint=joint).columns(record, SETTING) @ [0.02, -0.03]
    np.testing.assert_allclose(error, measured - true, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
@pytest.mark.parametrize("term", [CurvedReadingOfA, CurvedReadingOfB])
def test_one_transducer_that_bends_either_way(
    machine: Machine, joint: str, term: type[CurvedReadingOfA | CurvedReadingOfB]
) -> None:
    record, j = random_record(), PLANAR_JOINTS.index(joint)
    pressures = [record.pressure_a.copy(), record.pressure_b.copy()]
    true = generalized_forces(machine, record.position, *pressures, record.joints)
    ratio = pressures["AB".index(term.chamber)][:, j] / 1e7
    pressures["AB".index(term.chamber)][:, j] *= 1.0 + 0.02 * ratio - 0.05 * ratio**2
    measured = generalized_forces(machine, record.position, *pressures, record.joints)
    error = term(joint=joint).columns(record, SETTING) @ [0.02, -0.05]
    np.testing.assert_allclose(error, measured - true, rtol=1e-9, atol=1e-6)


def test_a_transducer_that_hears_the_other_joints(machine: Machine) -> None:
    record = random_record()
    p_a, p_b = record.pressure_a, record.pressure_b
    true = generalized_forces(machine, record.position, p_a, p_b, record.joints)
    j, others = PLANAR_JOINTS.index("outer_boom"), ("inner_boom", "telescope")
    term = OtherPressures(joint="outer_boom")
    heard, values = p_a.copy(), np.zeros(4)
    for name, pressure, share in (("A", p_a, 0.05), ("B", p_b, -0.08)):
        for other in others:
            heard[:, j] += share * pressure[:, PLANAR_JOINTS.index(other)]
            names = [one.name for one in term.parameters(SETTING)]
            values[names.index(f"share_{name}_{other}.outer_boom")] = share
    measured = generalized_forces(machine, record.position, heard, p_b, record.joints)
    error = term.columns(record, SETTING) @ values
    np.testing.assert_allclose(error, measured - true, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("term", [BentReading, CurvedReadingOfA, OtherPressures])
def test_without_a_cylinder_there_is_no_such_transducer(
    term: type[BentReading | CurvedReadingOfA | OtherPressures],
) -> None:
    with pytest.raises(ConfigurationError, match="needs a machine with a cylinder"):
        term(joint="outer_boom").parameters(SETTING._replace(machine=None))
