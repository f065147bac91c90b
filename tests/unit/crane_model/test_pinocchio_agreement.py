"""Inverse dynamics, regressor, M, C, G (3)-(8) against Pinocchio over 10,000 random states."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from unit.crane_model.lagrangian import (
    coriolis_matrix,
    energy,
    gravity_vector,
    inverse_dynamics,
    mass_matrix,
)
from unit.crane_model.pinocchio_crane import (
    dynamic_parameters,
    planar_crane,
    random_bodies,
    standard_from_pinocchio,
)

from crane_model import Model, Record
from crane_model.base_parameters import lagrangian_from_standard
from crane_model.dynamics import Geometry, lagrangian_regressor

TOLERANCE = 1e-9
CRANES, STATES_EACH = 20, 500  # 10,000 states


class Case(NamedTuple):
    """States of one crane with random bodies, and what Pinocchio says about them."""

    model: pin.Model
    nine: np.ndarray  # its parameters in the order of LAGRANGIAN_PARAMETERS
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


@pytest.fixture(scope="module")
def cases(geometry: Geometry) -> list[Case]:
    rng = np.random.default_rng(2)
    to_nine = lagrangian_from_standard(geometry) @ standard_from_pinocchio()
    result = []
    for seed in range(CRANES):
        bodies = random_bodies(seed)
        q = rng.uniform([-np.pi, -np.pi, -1.0], [np.pi, np.pi, 3.0], (STATES_EACH, 3))
        v, a = rng.standard_normal((2, STATES_EACH, 3)) * [[[2.0]], [[5.0]]]
        model = planar_crane(bodies, slew=rng.uniform(-np.pi, np.pi))
        result.append(Case(model, to_nine @ dynamic_parameters(bodies), q, v, a))
    return result


def worst_error(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest relative error over samples, each measured by the norm of its own entries."""
    samples = len(theirs)
    difference = np.linalg.norm((ours - theirs).reshape(samples, -1), axis=1)
    return float((difference / np.linalg.norm(theirs.reshape(samples, -1), axis=1)).max())


def evaluated(function, case: Case, *arguments: np.ndarray) -> np.ndarray:
    data = case.model.createData()
    return np.array([function(case.model, data, *row) for row in zip(*arguments, strict=True)])


def test_inverse_dynamics_by_the_regressor(cases: list[Case], geometry: Geometry) -> None:
    for case in cases:
        tau = lagrangian_regressor(geometry, case.q, case.v, case.a) @ case.nine
        assert worst_error(tau, evaluated(pin.rnea, case, case.q, case.v, case.a)) < TOLERANCE


def test_inverse_dynamics_by_mass_coriolis_and_gravity(
    cases: list[Case], geometry: Geometry
) -> None:
    for case in cases:
        tau = inverse_dynamics(geometry, case.nine, case.q, case.v, case.a)
        assert worst_error(tau, evaluated(pin.rnea, case, case.q, case.v, case.a)) < TOLERANCE


def test_regressor_in_all_thirty_parameters(cases: list[Case], geometry: Geometry) -> None:
    """Every column of Pinocchio's regressor, those that do nothing in the plane included."""
    to_nine = lagrangian_from_standard(geometry) @ standard_from_pinocchio()
    for case in cases:
        ours = lagrangian_regressor(geometry, case.q, case.v, case.a) @ to_nine
        theirs = evaluated(pin.computeJointTorqueRegressor, case, case.q, case.v, case.a)
        assert ours.shape == theirs.shape == (STATES_EACH, 3, 30)
        assert worst_error(ours, theirs) < TOLERANCE


def test_mass_matrix(cases: list[Case], geometry: Geometry) -> None:
    for case in cases:
        theirs = evaluated(pin.crba, case, case.q)
        upper = np.triu(theirs)
        theirs = upper + np.triu(theirs, 1).transpose(0, 2, 1)  # crba fills one triangle
        assert worst_error(mass_matrix(geometry, case.nine, case.q), theirs) < TOLERANCE


def test_coriolis_forces(cases: list[Case], geometry: Geometry) -> None:
    """C v, which unlike C itself is unique, as what is left of the bias without gravity."""
    for case in cases:
        data = case.model.createData()
        theirs = np.array(
            [
                pin.computeCoriolisMatrix(case.model, data, q, v) @ v
                for q, v in zip(case.q, case.v, strict=True)
            ]
        )
        coriolis = coriolis_matrix(geometry, case.nine, case.q, case.v)
        ours = np.einsum("nij,nj->ni", coriolis, case.v)
        assert worst_error(ours, theirs) < TOLERANCE


def test_gravity_vector(cases: list[Case], geometry: Geometry) -> None:
    for case in cases:
        theirs = evaluated(pin.computeGeneralizedGravity, case, case.q)
        assert worst_error(gravity_vector(geometry, case.nine, case.q), theirs) < TOLERANCE


def test_energy(cases: list[Case], geometry: Geometry) -> None:
    """The potential up to its constant: ours is zero at joint 2's height."""
    for case in cases:
        kinetic, potential = energy(geometry, case.nine, case.q, case.v)
        their_potential = evaluated(pin.computePotentialEnergy, case, case.q)
        assert worst_error(kinetic, evaluated(pin.computeKineticEnergy, case, case.q, case.v)) < (
            TOLERANCE
        )
        assert np.ptp(potential - their_potential) < TOLERANCE * np.ptp(their_potential)


def test_base_regressor_of_the_model_file(cases: list[Case], crane: Model) -> None:
    """The eight columns with the telescope's centre of mass on its axis: N_TL = a3 m_TL."""
    offset = crane.machine.as_planar().telescope_offset
    for seed, case in enumerate(cases):
        bodies = random_bodies(seed)
        body = bodies["TG"]  # put its centre of mass on the axis, z of the telescope's frame
        body.lever = np.array([0.0, body.lever[1], body.lever[2]])
        model = planar_crane(bodies)
        nine = lagrangian_from_standard(Geometry.of(crane.machine)) @ (
            standard_from_pinocchio() @ dynamic_parameters(bodies)
        )
        assert nine[8] == pytest.approx(offset * nine[6], rel=1e-12)
        record = Record(crane.joints, np.arange(STATES_EACH) * 0.01, case.q, case.v, case.a)
        tau = crane.regressor(record)[:, :, :8] @ nine[:8]
        theirs = evaluated(pin.rnea, case._replace(model=model), case.q, case.v, case.a)
        assert worst_error(tau, theirs) < TOLERANCE
