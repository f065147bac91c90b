"""EMPS, a measured prismatic axis: the published identification, through the public API.

Janot, Gautier, Brunot (2019): data set and reference models of EMPS. Nothing in this test knows
how the numbers come about but the options, which are the authors' processing.
"""

from pathlib import Path

import numpy as np
import pytest
from integration.emps_published import (
    CONDITION_NUMBER,
    FILES,
    NAMES,
    PROCESSING,
    RELATIVE_ERROR,
    STD_DEVS,
    VALUES,
    recording,
)

from crane_identification import FitResult, Log, Options, fit, validate
from crane_model import Model, load_model


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(FILES / "model.yaml")


@pytest.fixture(scope="module")
def log(real_data: Path, model: Model) -> Log:
    return recording(real_data, model.joints)


@pytest.fixture(scope="module")
def published(model: Model, log: Log) -> FitResult:
    return fit(model, [log], PROCESSING)


def test_every_printed_digit(published: FitResult) -> None:
    estimate = published.estimate
    assert estimate.names == NAMES
    np.testing.assert_array_equal(np.round(estimate.values, 4), VALUES)
    np.testing.assert_array_equal(np.round(estimate.std_devs, 4), STD_DEVS)


def test_condition_number_and_relative_error(published: FitResult) -> None:
    assert round(published.estimate.condition_number, 4) == CONDITION_NUMBER
    assert round(float(published.estimate.relative_error[0]), 6) == RELATIVE_ERROR
    assert published.estimate.units == ("kg", "N s/m", "N", "N")


def test_defaults_agree_with_the_authors(model: Model, log: Log, published: FitResult) -> None:
    """The smoother and the mask, tuned by the data alone, find the same machine."""
    ours = fit(model, [log], Options(average=False)).estimate
    difference = ours.values - published.estimate.values
    assert (np.abs(difference) < 3 * ours.std_devs).all()
    assert (ours.std_devs > published.estimate.std_devs).all()  # the residual is not white


def test_prediction_is_as_good_as_the_fit(model: Model, log: Log, published: FitResult) -> None:
    (validation,) = validate(published.model, [log], PROCESSING)
    assert validation.relative_error == pytest.approx(published.estimate.relative_error, rel=1e-9)
    assert np.isnan(validation.noise_floor).all()  # not periodic: nothing to compare
