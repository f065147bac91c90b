"""Fits under physical constraints: physical always, least squares wherever that is physical."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import AXIS_THETA, axis_log, axis_model, crane_model
from unit.crane_model.lagrangian import mass_matrix

from crane_identification import Estimate, Estimator, FitResult, Options, fit
from crane_identification.estimation.consistent import (
    FELT_SIGMAS,
    LEAST_EIGENVALUE_IN_PLANE,
    consistent,
    physics,
)
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import Rows, balancing
from crane_model import Machine, Model
from crane_model.dynamics import Geometry

POSES = 1000


def machine() -> Machine:
    found = crane_model().machine
    assert found is not None
    return found


def smallest_eigenvalue(values: np.ndarray, poses: int = POSES) -> np.ndarray:
    """Of the mass matrix, in poses (n,) all over Table 2."""
    geometry, limits = Geometry.of(machine()), [machine().limits[j] for j in PLANAR_JOINTS]
    low, high = (
        np.array([getattr(x, f"position_{end}") for x in limits]) for end in ("min", "max")
    )
    q = np.random.default_rng(1).uniform(low, high, size=(poses, 3))
    parameters = np.append(values[:8], geometry.telescope_offset * values[6])
    return np.linalg.eigvalsh(mass_matrix(geometry, parameters, q))[:, 0]


def bodies_exist(values: np.ndarray, smallest: float = 0.0) -> bool:
    """Whether planar bodies have these base parameters, solved by hand.

    The mass of the inner boom is free, so that it asks only for a positive inertia: that bounds the
    mass of the outer boom from above, and the more mass it has, the less inertia it needs.
    """
    geometry = Geometry.of(machine())
    j_fl, _, _, j_sl, s_sl, n_sl, m_tl, s_tl = values[:8]
    m_sl = j_fl / geometry.inner_boom_length**2 - m_tl
    if m_tl <= smallest or m_sl <= smallest:
        return False
    normal = geometry.telescope_offset * m_tl
    inertia = ((s_sl - s_tl) ** 2 + (n_sl - normal) ** 2) / m_sl
    return j_sl > inertia + (s_tl**2 + normal**2) / m_tl


@pytest.fixture(scope="module")
def good() -> FitResult:
    """A fit of plenty of data."""
    return fit(crane_model(), [experiment(1)], Options(estimator=Estimator.LEAST_SQUARES))


def scarce(rows: Rows, seed: int, noise: float = 30.0) -> Rows:
    """Half of the rows, with noise on top, so that least squares finds the unphysical."""
    rng = np.random.default_rng(seed)
    disturbed = rows.force + noise * rng.normal(size=rows.force.shape)
    used = rows.used & (rng.random(len(rows.time)) < 0.5)[:, None]
    return replace(rows, force=disturbed, used=used, scatter=())


def test_where_least_squares_is_physical_it_is_the_answer(good: FitResult) -> None:
    estimate = consistent(good.rows, physics(crane_model()))
    assert bodies_exist(good.estimate.values)
    assert estimate.bounds == ()
    np.testing.assert_allclose(estimate.values, good.estimate.values, rtol=1e-5)
    np.testing.assert_array_equal(estimate.std_devs, good.estimate.std_devs)


@pytest.fixture(scope="module")
def pairs(good: FitResult) -> list[tuple[Rows, Estimate, Estimate]]:
    """Scarce rows, with least squares on them and the physical fit."""
    systems = [scarce(good.rows, seed) for seed in range(12)]
    asked = physics(crane_model())
    return [(rows, least_squares(rows), consistent(rows, asked)) for rows in systems]


def test_physical_fits_have_bodies_and_a_positive_definite_mass_matrix(
    pairs: list[tuple[Rows, Estimate, Estimate]],
) -> None:
    """Of the same rows least squares makes machines that cannot exist."""
    physical = [bodies_exist(plain.values) for _, plain, _ in pairs]
    assert physical.count(False) >= 2
    for was, (_, plain, estimate) in zip(physical, pairs, strict=True):
        assert bodies_exist(estimate.values)
        assert (smallest_eigenvalue(estimate.values) > 0.0).all()
        if was and not physics(crane_model()).violated(plain.values):
            np.testing.assert_allclose(estimate.values, plain.values, rtol=1e-3, atol=0.1)
            assert estimate.bounds == ()
        elif (np.abs(estimate.values - plain.values) > FELT_SIGMAS * plain.std_devs).any():
            assert any("pseudo-inertia" in name for name in estimate.bounds)


def test_no_physical_neighbour_fits_better(pairs: list[tuple[Rows, Estimate, Estimate]]) -> None:
    """Optimality, by trying: steps towards other physical parameters only make the fit worse."""
    truth, rng = crane_model().theta, np.random.default_rng(2)
    for rows, _, estimate in pairs[:4]:
        weights = balancing(rows)

        def cost(values: np.ndarray, rows: Rows = rows, weights: np.ndarray = weights) -> float:
            return float(((weights * rows.residual(values)) ** 2).sum())

        least = cost(estimate.values)
        for _ in range(50):
            changed = truth * rng.uniform(0.9, 1.1, size=20)
            if bodies_exist(changed, LEAST_EIGENVALUE_IN_PLANE):
                step = rng.uniform(0.001, 0.5)
                assert cost(estimate.values + step * (changed - estimate.values)) > least * (
                    1 - 1e-3
                )


def test_friction_brakes_in_both_directions(tmp_path: Path) -> None:
    """An axis whose friction would push: every minimum, and the asymmetry of each direction."""
    model = axis_model(tmp_path)
    found = fit(model, [axis_log(1, model)], Options(estimator=Estimator.LEAST_SQUARES))
    pushing = replace(found.rows, force=found.rows.force - found.rows.matrix[:, :, 2] * 10.0)
    assert least_squares(pushing).values[2] < -1.0
    estimate = consistent(pushing, physics(model))
    assert estimate.values[2] == pytest.approx(0.0, abs=1e-6)
    assert estimate.bounds == ("f_c.axis >= 0",)
    assert estimate.values[estimate.names.index("f_c.axis")] == 0.0  # exactly, as it is printed
    assert estimate.values[0] == pytest.approx(AXIS_THETA[0], rel=0.1)
    names = [inequality.name for inequality in physics(crane_model()).inequalities]
    for joint in PLANAR_JOINTS:
        assert {f"f_c.{joint} + df_c.{joint} >= 0", f"f_v.{joint} - df_v.{joint} >= 0"} <= set(
            names
        )
    assert {"J_FL >= 0", "J_SL >= 0", "m_TL >= 0"} <= set(names)


def test_the_estimator_of_a_fit_is_the_physical_one(good: FitResult) -> None:
    found = fit(crane_model(), [experiment(1)])
    assert found.estimate.method.startswith("physically consistent")
    np.testing.assert_allclose(found.estimate.values, good.estimate.values, rtol=1e-5)
    assert isinstance(found.model, Model)
