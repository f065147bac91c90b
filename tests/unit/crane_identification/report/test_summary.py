import json
from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.report.synthetic_crane import PRESSURE_NOISE

from crane_identification.report import summary
from crane_identification.signals.decimate import PASS_BAND_SHARE


def test_summary_survives_json(report, tmp_path):
    summary.write(tmp_path / "summary.json", report)
    assert summary.Summary.read(tmp_path / "summary.json") == summary.summarize(report)


def test_parameters_are_those_of_the_fitted_model(report):
    listed = summary.summarize(report).parameters
    model = report.fit.model
    assert [(p.name, p.unit) for p in listed] == [(p.name, p.unit) for p in model.parameters]
    np.testing.assert_array_equal([p.value for p in listed], model.values)
    np.testing.assert_array_equal([p.std_dev for p in listed], model.std_devs)


def test_errors_are_those_of_all_held_out_samples_together(report):
    result = summary.summarize(report)
    measured = np.concatenate([v.measured for v in report.validations])
    predicted = np.concatenate([v.predicted for v in report.validations])
    gravity = np.concatenate([v.gravity for v in report.validations])
    for j, joint in enumerate(report.fit.model.joints):
        error = np.sqrt(np.sum((measured - predicted)[:, j] ** 2))
        assert result.heldout_relative_error[joint] == pytest.approx(
            error / np.sqrt(np.sum(measured[:, j] ** 2))
        )
        assert result.heldout_relative_error_without_gravity[joint] == pytest.approx(
            error / np.sqrt(np.sum((measured - gravity)[:, j] ** 2))
        )


def test_one_recording_alone_has_its_own_errors(report):
    single = replace(report, validations=report.validations[:1])
    result, validation = summary.summarize(single), report.validations[0]
    error, rows = validation.measured - validation.predicted, validation.rows
    net = validation.measured - validation.gravity
    moving = rows.norms(rows.residual(report.fit.model.theta)) / rows.norms(rows.force)
    rms = np.sqrt((validation.measured**2).mean(axis=0))
    for key, expected in (
        ("heldout_relative_error", validation.relative_error),
        (
            "heldout_relative_error_without_gravity",
            np.linalg.norm(error, axis=0) / np.linalg.norm(net, axis=0),
        ),
        ("heldout_relative_error_moving", moving),
        ("noise_floor", validation.noise_floor / rms),
    ):
        np.testing.assert_allclose(list(getattr(result, key).values()), expected)


def test_noise_floor_is_the_noise_of_the_pressures(report):
    """Through the piston areas, the mean over the periods and the pass band of the filter."""
    cylinder = report.fit.model.machine.cylinders["telescope"]
    force_noise = PRESSURE_NOISE * np.hypot(cylinder.area_a, cylinder.area_b)
    periods = report.validations[0].preparation.averaging.used
    expected = force_noise / np.sqrt(periods) * np.sqrt(PASS_BAND_SHARE / report.fit.decimation)
    force = np.concatenate([v.measured[:, 2] for v in report.validations])
    floor = summary.summarize(report).noise_floor["telescope"] * np.sqrt(np.mean(force**2))
    assert floor == pytest.approx(expected, rel=0.25)


def test_without_validation_there_are_no_held_out_errors(report):
    result = summary.summarize(replace(report, validations=()))
    assert result.heldout_relative_error == result.noise_floor == {}
    assert result.validation_bags == []
    assert set(result.training_relative_error) == set(report.fit.model.joints)


def test_what_is_not_a_number_is_null(report):
    values = report.fit.estimate.values.copy()
    values[0] = np.nan
    estimate = replace(report.fit.estimate, values=values, condition_number=np.inf)
    result = summary.summarize(replace(report, fit=replace(report.fit, estimate=estimate)))
    assert result.parameters[0].value is None
    assert result.condition_number is None
    json.dumps(result.plain(), allow_nan=False)
