"""Criteria of (35) and their derivatives, against numpy and numeric differentiation."""

import numpy as np
import pytest

from crane_model import ConfigurationError, Model, load_model
from crane_model.base_parameters import report_from_base
from crane_model.dynamics import Geometry
from crane_model.machine_files import machine_file
from crane_trajectory import load_design_settings, load_trajectory
from crane_trajectory.excitation.criterion import (
    ColumnSet,
    Criterion,
    CriterionKind,
    column_map,
    information,
    log_condition,
    log_normalised_condition,
    log_std_dev,
    log_volume,
    one_period,
    relative_std_devs,
)

MODEL = load_model(machine_file("model.yaml"))
SETTINGS = load_design_settings(machine_file("design.yaml"))
PHI = one_period(MODEL, load_trajectory(machine_file("excitation_20s.yaml")), samples=100)
STACKED = PHI.reshape(-1, 20)
JUDGED = SETTINGS.experiment, SETTINGS.plausible
NOISE = np.array([SETTINGS.experiment.noise[joint] for joint in MODEL.joints])


def well_conditioned(rng, size=6):
    columns = rng.standard_normal((30, size)) * np.linspace(1.0, 3.0, size)
    return columns.T @ columns


def std_dev(gram):
    return log_std_dev(gram, np.arange(1.0, 7.0))


@pytest.mark.parametrize("function", [log_condition, log_normalised_condition, log_volume, std_dev])
def test_slopes_are_derivatives(function):
    rng = np.random.default_rng(0)
    gram = well_conditioned(rng)
    direction = rng.standard_normal(gram.shape)
    direction += direction.T
    step = 1e-5
    numeric = (function(gram + step * direction)[0] - function(gram - step * direction)[0]) / (
        2 * step
    )
    assert (function(gram)[1] * direction).sum() == pytest.approx(numeric, rel=1e-6)


def test_slope_where_eigenvalues_are_equal_is_that_of_the_power_mean():
    value, slope = log_condition(np.diag([9.0, 1.0, 1.0]), 4.0)
    assert value == pytest.approx(0.5 * (np.log(9.0) + np.log(2.0) / 4), abs=1e-3)
    assert slope[1, 1] == pytest.approx(slope[2, 2])


@pytest.mark.parametrize("power", [8.0, 50.0])
def test_power_means_approach_the_condition_number_from_above(power):
    gram = STACKED.T @ STACKED
    exact = np.log(np.linalg.cond(STACKED))
    assert exact < log_condition(gram, power).value < exact + np.log(20.0) / power


@pytest.mark.parametrize(
    ("kind", "columns", "expected"),
    [
        (CriterionKind.RAW, ColumnSet.BASE, np.linalg.cond(STACKED)),
        (CriterionKind.RAW, ColumnSet.INERTIAL, np.linalg.cond(STACKED[:, :8])),
        (
            CriterionKind.NORMALISED,
            ColumnSet.BASE,
            np.linalg.cond(STACKED / np.linalg.norm(STACKED, axis=0)),
        ),
    ],
)
def test_criterion_is_the_log_of_the_condition_number(kind, columns, expected):
    criterion = Criterion.of(MODEL, kind, columns, *JUDGED)
    assert criterion.exact(criterion.gram(PHI)) == pytest.approx(np.log(expected), rel=1e-6)


def test_product_is_that_of_raw_and_normalised():
    raw, normalised, product = (
        Criterion.of(MODEL, kind, ColumnSet.BASE, *JUDGED)
        for kind in (CriterionKind.RAW, CriterionKind.NORMALISED, CriterionKind.PRODUCT)
    )
    gram = raw.gram(PHI)
    assert product.exact(gram) == pytest.approx(raw.exact(gram) + normalised.exact(gram))
    np.testing.assert_allclose(
        product.evaluate(gram).slope, raw.evaluate(gram).slope + normalised.evaluate(gram).slope
    )


def test_columns_of_9_give_the_same_force():
    to_report = report_from_base(Geometry.of(MODEL.machine))
    theta = np.arange(1.0, 21.0)
    reported = np.concatenate([to_report @ theta[:8], theta[8:]])
    columns = column_map(MODEL, ColumnSet.REPORT)
    np.testing.assert_allclose(STACKED @ columns @ reported, STACKED @ theta, rtol=1e-9)


def test_d_optimality_weighs_rows_by_their_noise():
    criterion = Criterion.of(MODEL, CriterionKind.D_OPTIMALITY, ColumnSet.BASE, *JUDGED)
    weighted = (PHI / NOISE[:, None]).reshape(-1, 20)
    _, volume = np.linalg.slogdet(weighted.T @ weighted)
    assert criterion.exact(criterion.gram(PHI)) == pytest.approx(-volume / 40.0)


@pytest.mark.parametrize("kind", list(CriterionKind))
def test_a_trajectory_of_a_campaign_counts_with_all_data_and_by_itself(kind):
    criterion = Criterion.of(MODEL, kind, ColumnSet.BASE, *JUDGED)
    later = criterion.after(PHI[:50])
    gram, both = criterion.gram(PHI[50:]), criterion.gram(PHI)
    alone, together = criterion.exact(gram), criterion.exact(both)
    assert later.exact(gram) == pytest.approx(alone + 2 * together)
    np.testing.assert_allclose(
        later.evaluate(gram).slope,
        criterion.evaluate(gram).slope + 2 * criterion.evaluate(both).slope,
        rtol=1e-6,
    )


def test_a_model_without_the_columns_of_9_is_refused():
    model = Model("friction only", MODEL.setting, MODEL.terms[1:])
    with pytest.raises(ConfigurationError, match="'friction only'.*planar_rigid_body"):
        column_map(model, ColumnSet.REPORT)


def test_a_optimality_is_the_mean_square_of_the_predicted_relative_std_devs():
    criterion = Criterion.of(MODEL, CriterionKind.A_OPTIMALITY, ColumnSet.BASE, *JUDGED)
    recorded = SETTINGS.experiment.model_copy(update={"periods": 1, "sample_rate": 5.0})
    told = information(MODEL, PHI, 20.0, recorded)  # as many samples as PHI has
    predicted = np.array(list(relative_std_devs(MODEL, told, SETTINGS.plausible).values()))
    expected = 0.5 * np.log((predicted**2).mean())
    assert criterion.exact(criterion.gram(PHI)) == pytest.approx(expected, rel=1e-6)


def test_a_optimality_needs_plausible_values():
    with pytest.raises(ConfigurationError, match=r"no value for .*J_FL.*a-optimality"):
        Criterion.of(MODEL, CriterionKind.A_OPTIMALITY, ColumnSet.BASE, SETTINGS.experiment, {})
