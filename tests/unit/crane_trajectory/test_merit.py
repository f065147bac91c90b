"""Condition numbers and predicted standard deviations against numpy and Monte Carlo."""

import numpy as np
import pytest

from crane_model import Model, load_model
from crane_model.machine_files import machine_file
from crane_trajectory import load_design_settings, load_trajectory
from crane_trajectory.excitation.criterion import (
    ColumnSet,
    column_map,
    condition_numbers,
    figures_of_merit,
    inertial_columns,
    information,
    one_period,
    relative_std_devs,
)

MODEL = load_model(machine_file("model.yaml"))
TRAJECTORY = load_trajectory(machine_file("excitation_20s.yaml"))
SETTINGS = load_design_settings(machine_file("design.yaml"))


def test_condition_numbers_are_those_of_the_singular_values():
    phi = one_period(MODEL, TRAJECTORY, 200).reshape(-1, 20)
    batch = np.stack([phi, phi[::2].repeat(2, axis=0)])
    raw, normalised = condition_numbers(batch.transpose(0, 2, 1) @ batch)
    for i, matrix in enumerate(batch):
        unit = matrix / np.linalg.norm(matrix, axis=0)
        assert raw[i] == pytest.approx(np.linalg.cond(matrix), rel=1e-6)
        assert normalised[i] == pytest.approx(np.linalg.cond(unit), rel=1e-6)


def test_a_column_that_is_never_excited_is_very_badly_conditioned_but_finite():
    gram = np.diag([4.0, 1.0, 0.0])
    raw, normalised = condition_numbers(gram)
    assert 1e7 < raw < np.inf
    assert 1e7 < normalised < np.inf


def test_inertial_columns_are_the_eight_base_parameters():
    names = [
        parameter.name
        for parameter, inertial in zip(MODEL.parameters, inertial_columns(MODEL), strict=True)
        if inertial
    ]
    assert names == [parameter.name for parameter in MODEL.parameters[:8]]
    assert names[0] == "J_FL"


def test_predicted_std_devs_are_those_of_repeated_fits():
    rng = np.random.default_rng(0)
    regressor = one_period(MODEL, TRAJECTORY, 200)
    noise = np.array([SETTINGS.experiment.noise[joint] for joint in MODEL.joints])
    weighted = (regressor / noise[:, None]).reshape(-1, 20)
    fits = rng.normal(size=(2000, len(weighted))) @ np.linalg.pinv(weighted).T
    experiment = SETTINGS.experiment.model_copy(update={"periods": 1, "sample_rate": 10.0})
    plausible = {"J_FL": 450.0, "f_c.telescope": -7.0}
    told = information(MODEL, regressor, TRAJECTORY.period, experiment)
    predicted = relative_std_devs(MODEL, told, plausible)
    names = [parameter.name for parameter in MODEL.parameters]
    assert list(predicted) == ["J_FL", "f_c.telescope"]
    for name, value in plausible.items():
        spread = fits[:, names.index(name)].std() / abs(value)
        assert predicted[name] == pytest.approx(spread, rel=0.06)


@pytest.mark.parametrize(("periods", "rate"), [(20, 200.0), (5, 800.0)])
def test_four_times_the_samples_halve_the_std_devs(periods, rate):
    more = SETTINGS.experiment.model_copy(update={"periods": periods, "sample_rate": rate})
    few, many = (
        figures_of_merit(MODEL, TRAJECTORY, 100, experiment, SETTINGS.plausible)
        for experiment in (SETTINGS.experiment, more)
    )
    for name in SETTINGS.plausible:
        key = f"relative_std_dev.{name}"
        assert many[key] == pytest.approx(few[key] / 2)
    assert many["condition_number"] == few["condition_number"]


def test_numbers_of_the_columns_of_9_are_those_of_the_report_s_parameters():
    merit = figures_of_merit(MODEL, TRAJECTORY, 200, SETTINGS.experiment, SETTINGS.plausible)
    phi = one_period(MODEL, TRAJECTORY, 200).reshape(-1, 20)
    # m_SL is seen only as a moment normal to the telescope's axis, which makes (9) worse
    reported = phi @ column_map(MODEL, ColumnSet.REPORT)
    assert merit["condition_number_report"] == pytest.approx(np.linalg.cond(reported), rel=1e-6)
    assert merit["condition_number_report"] > merit["condition_number"]
    inertial = np.linalg.cond(reported[:, :8])
    assert merit["condition_number_report_inertial"] == pytest.approx(inertial, rel=1e-6)


def test_a_model_without_rigid_bodies_has_no_numbers_of_9():
    model = Model("friction only", MODEL.setting, MODEL.terms[1:])
    merit = figures_of_merit(model, TRAJECTORY, 100, SETTINGS.experiment, SETTINGS.plausible)
    assert not [name for name in merit if "report" in name or "inertial" in name]
    assert merit["condition_number"] > 1.0
