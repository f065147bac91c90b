"""Which parameters motion determines: ranks, combinations, and the way to the entries of (9)."""

import re

import numpy as np
import pinocchio as pin
import pytest
from unit.crane_model.lagrangian import LAGRANGIAN_PARAMETERS
from unit.crane_model.pinocchio_crane import A_3, planar_crane, random_bodies

from crane_model import Model, Record
from crane_model.base_parameters import (
    REPORT_PARAMETERS,
    REPORT_UNITS,
    STANDARD_PARAMETERS,
    lagrangian_from_standard,
    report_from_base,
    reveal_rank,
)
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.terms.rigid_body import BASE_PARAMETERS

SAMPLES = 300


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    q = rng.uniform([-0.45, -2.7, 0.0], [1.37, -0.1, 1.55], (SAMPLES, 3))
    v, a = rng.standard_normal((2, SAMPLES, 3))
    return q, v, a


@pytest.fixture(scope="module")
def standard_columns(geometry: Geometry, motion) -> np.ndarray:
    """(3 samples, 12): the stacked regressor of the standard parameters."""
    columns = lagrangian_regressor(geometry, *motion) @ lagrangian_from_standard(geometry)
    return columns.reshape(-1, 12)


def standard(name: str) -> np.ndarray:
    """Unit vector of one standard parameter."""
    return np.eye(12)[STANDARD_PARAMETERS.index(name)]


def test_twelve_standard_parameters_have_rank_nine(standard_columns: np.ndarray) -> None:
    basis = reveal_rank(standard_columns)
    assert basis.rank == 9
    assert basis.margin > 1e6


def test_thirty_parameters_of_pinocchio_have_rank_nine(motion) -> None:
    model = planar_crane(random_bodies(0))
    data = model.createData()
    rows = [
        pin.computeJointTorqueRegressor(model, data, *row).copy()
        for row in zip(*motion, strict=True)
    ]
    assert reveal_rank(np.concatenate(rows)).rank == 9


def test_rank_eight_with_the_telescope_on_its_axis(standard_columns: np.ndarray) -> None:
    """The normal moment of telescope and gripper is then a3 times their mass."""
    with_mass = standard("m_TG") + A_3 * standard("my_TG")
    others = [standard(n) for n in STANDARD_PARAMETERS if n not in ("m_TG", "my_TG")]
    basis = reveal_rank(standard_columns @ np.stack([with_mass, *others]).T)
    assert basis.rank == 8
    assert basis.margin > 1e6


def test_model_of_the_report_has_rank_twenty(crane: Model, motion) -> None:
    """8 inertial and 12 friction columns, all determined."""
    columns = crane.regressor(Record(crane.joints, np.arange(SAMPLES) * 0.01, *motion))
    basis = reveal_rank(columns.reshape(-1, 20))
    assert basis.rank == 20
    assert basis.dependent == ()
    assert sorted(basis.independent) == list(range(20))
    assert reveal_rank(columns[:, :, :8].reshape(-1, 8)).rank == 8


def test_combination_gives_the_dependent_columns(standard_columns: np.ndarray) -> None:
    basis = reveal_rank(standard_columns)
    independent = standard_columns[:, basis.independent]
    dependent = standard_columns[:, basis.dependent]
    np.testing.assert_allclose(independent @ basis.combination, dependent, atol=1e-10)
    theta = np.random.default_rng(8).standard_normal(12)
    base = theta[list(basis.independent)] + basis.combination @ theta[list(basis.dependent)]
    np.testing.assert_allclose(independent @ base, standard_columns @ theta, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rank_does_not_depend_on_units(standard_columns: np.ndarray, scale: float) -> None:
    units = np.where(np.arange(12) % 2, scale, 1.0)
    assert reveal_rank(standard_columns * units).rank == 9


def test_rank_without_excitation(geometry: Geometry) -> None:
    assert reveal_rank(np.zeros((10, 3))).rank == 0
    place, still = np.tile([0.3, -0.5, 0.4], (20, 1)), np.zeros((20, 3))
    held = lagrangian_regressor(geometry, place, still, still).reshape(-1, 9)
    assert reveal_rank(held).rank == 3  # one posture tells three forces


def columns_of_report(
    standard_columns: np.ndarray, sl_along: np.ndarray, sl_mass: np.ndarray
) -> np.ndarray:
    """Columns of the entries of (9), given what the moment and the mass of SL stand for."""
    tl_mass = standard("m_TG") + A_3 * standard("my_TG")
    entries = [
        standard("J_FL"),
        sl_along,
        sl_mass,
        standard("mx_TG"),
        tl_mass,
        standard("J_SL"),
        standard("mx_FL"),
        standard("my_FL"),
    ]
    return standard_columns @ np.stack(entries).T


def test_entries_of_equation_9_have_rank_eight_with_sl_on_the_axis(
    standard_columns: np.ndarray,
) -> None:
    mass = standard("m_SL") + A_3 * standard("my_SL")
    columns = columns_of_report(standard_columns, standard("mx_SL"), mass)
    assert reveal_rank(columns).rank == 8


@pytest.mark.parametrize("direction", [0.0, 0.3])
def test_entries_of_equation_9_have_rank_seven_with_sl_on_a_line_through_the_elbow(
    standard_columns: np.ndarray, direction: float
) -> None:
    moment = np.cos(direction) * standard("mx_SL") + np.sin(direction) * standard("my_SL")
    columns = columns_of_report(standard_columns, moment, standard("m_SL"))
    assert reveal_rank(columns).rank == 7


def test_columns_of_equation_9_are_those_of_the_base_set(
    geometry: Geometry, motion, standard_columns: np.ndarray
) -> None:
    mass = standard("m_SL") + A_3 * standard("my_SL")
    expected = columns_of_report(standard_columns, standard("mx_SL"), mass)
    nine = lagrangian_regressor(geometry, *motion).reshape(-1, 9)
    base = nine[:, :8].copy()
    base[:, 6] += A_3 * nine[:, 8]
    columns = base @ np.linalg.inv(report_from_base(geometry))
    np.testing.assert_allclose(columns, expected, atol=1e-10)


def test_true_bodies_give_the_literal_entries_of_equation_9(geometry: Geometry) -> None:
    """Masses, distances and central inertias of five bodies, all of them but FL on the axis."""
    m_fl, along_fl, normal_fl, izz_fl = 130.0, 0.62, 0.05, 22.0
    m_sl, along_sl, izz_sl = 85.0, 0.55, 18.0
    m_tl, along_tl, izz_tl = 62.0, 0.80, 14.0
    m_gr, r_7, izz_gr = 70.0, 1.813, 2.0
    bodies = [
        [m_fl, m_fl * along_fl, m_fl * normal_fl, izz_fl + m_fl * (along_fl**2 + normal_fl**2)],
        [m_sl, m_sl * along_sl, m_sl * A_3, izz_sl + m_sl * (along_sl**2 + A_3**2)],
        [
            m_tl + m_gr,
            m_tl * along_tl + m_gr * r_7,
            (m_tl + m_gr) * A_3,
            izz_tl + m_tl * (along_tl**2 + A_3**2) + izz_gr + m_gr * (r_7**2 + A_3**2),
        ],
    ]
    base = (lagrangian_from_standard(geometry) @ np.ravel(bodies))[:8]
    rcm_fl_squared = along_fl**2 + normal_fl**2
    rcm_sl_squared, rcm_tl_squared = along_sl**2 + A_3**2, along_tl**2 + A_3**2
    izz_gr_about_elbow = izz_gr + m_gr * (r_7**2 + A_3**2)
    literal = [
        m_fl * rcm_fl_squared + izz_fl,
        along_sl * m_sl,
        m_sl,
        m_gr * r_7 + along_tl * m_tl,
        m_tl + m_gr,
        m_tl * rcm_tl_squared + izz_sl + izz_tl + m_sl * rcm_sl_squared + izz_gr_about_elbow,
        m_fl * along_fl,
        m_fl * normal_fl,
    ]
    np.testing.assert_allclose(report_from_base(geometry) @ base, literal, rtol=1e-12)


def test_names_and_units_stand_side_by_side() -> None:
    assert len(STANDARD_PARAMETERS) == len(set(STANDARD_PARAMETERS)) == 12
    assert len(REPORT_PARAMETERS) == len(set(REPORT_PARAMETERS)) == len(REPORT_UNITS) == 8
    assert tuple(p.name for p in BASE_PARAMETERS) == LAGRANGIAN_PARAMETERS[:8]
    unit = {"m": "kg", "S": "kg m", "J": "kg m2"}
    assert [p.unit for p in BASE_PARAMETERS] == [unit[p.name[0]] for p in BASE_PARAMETERS]
    for name, unit_of_entry in zip(REPORT_PARAMETERS, REPORT_UNITS, strict=True):
        power = 2 if "^2" in name else 1 if re.search(r"\br(cm|7)", name) else 0
        assert unit_of_entry == ("kg", "kg m", "kg m2")[power]
