"""Condition numbers and predicted standard deviations against numpy and Monte Carlo."""

import numpy as np
import pytest

from crane_model.configuration import packaged
from crane_model.model_file import load_model
from crane_trajectory.excitation import load_design_settings
from crane_trajectory.fourier import load_trajectory
from crane_trajectory.merit import (
    condition_numbers,
    figures_of_merit,
    inertial_columns,
    record_of,
    relative_std_devs,
)

MODEL = load_model(packaged("crane_model", "crane_model.yaml"))
TRAJECTORY = load_trajectory(packaged("crane_trajectory", "excitation_20s.yaml"))
SETTINGS = load_design_settings()


def stacked_regressor(samples):
    time = np.arange(samples) * TRAJECTORY.period / samples
    return MODEL.regressor(record_of(MODEL, TRAJECTORY.evaluate(time)))


def test_condition_numbers_are_those_of_the_singular_values():
    phi = stacked_regressor(200).reshape(-1, 20)
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
    regressor = stacked_regressor(200)
    noise = np.array([SETTINGS.experiment.noise[joint] for joint in MODEL.joints])
    weighted = (regressor / noise[:, None]).reshape(-1, 20)
    fits = rng.normal(size=(2000, len(weighted))) @ np.linalg.pinv(weighted).T
    one_period = SETTINGS.experiment.model_copy(update={"periods": 1, "sample_rate": 10.0})
    plausible = {"J_FL": 450.0, "f_c.telescope": -7.0}
    predicted = relative_std_devs(MODEL, regressor, TRAJECTORY.period, one_period, plausible)
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
