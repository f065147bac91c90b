"""EMPS, a measured prismatic axis: the published identification, through the public API.

Janot, Gautier, Brunot (2019): data set and reference models of EMPS. Nothing in this test knows
how the numbers come about but the options, which are the authors' processing.
"""

from pathlib import Path

import numpy as np
import pytest

from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.table_log import read_table
from crane_identification.estimation.covariance import Covariance
from crane_identification.options import Options
from crane_identification.pipeline import FitResult, fit, validate
from crane_identification.signals.butterworth import ButterworthDifferentiator
from crane_model.configuration import load
from crane_model.model_file import Model, load_model

FILES = Path(__file__).parent / "emps"
NAMES = ("inertia.axis", "f_v.axis", "f_c.axis", "offset.axis")
PUBLISHED = {
    "values": (95.1089, 203.5034, 20.3935, -3.1648),
    "std_devs": (0.1085, 1.146, 0.1012, 0.0444),
}
AUTHORS = Options(
    motion=ButterworthDifferentiator(cutoff=100.0, order=4),
    average=False,
    trim=(49, 0),
    mask_reversals=False,
    decimation=10,
    covariance=Covariance.SAMPLE,
)


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(FILES / "model.yaml")


@pytest.fixture(scope="module")
def log(real_data: Path, model: Model) -> Log:
    path = real_data / "emps" / "DATA_EMPS.mat"
    return read_table(path, load(FILES / "columns.yaml", ColumnMap), model.joints)


@pytest.fixture(scope="module")
def published(model: Model, log: Log) -> FitResult:
    return fit(model, [log], AUTHORS)


@pytest.mark.parametrize("quantity", PUBLISHED)
def test_every_printed_digit(published: FitResult, quantity: str) -> None:
    assert published.estimate.names == NAMES
    np.testing.assert_array_equal(
        np.round(getattr(published.estimate, quantity), 4), PUBLISHED[quantity]
    )


def test_condition_number_and_relative_error(published: FitResult) -> None:
    assert round(published.estimate.condition_number, 4) == 25.9883
    assert round(100 * float(published.estimate.relative_error[0]), 4) == 4.0834
    assert published.estimate.units == ("kg", "N s/m", "N", "N")


def test_defaults_agree_with_the_authors(model: Model, log: Log, published: FitResult) -> None:
    """The smoother and the mask, tuned by the data alone, find the same machine."""
    ours = fit(model, [log], Options(average=False)).estimate
    difference = ours.values - published.estimate.values
    assert (np.abs(difference) < 3 * ours.std_devs).all()
    assert (ours.std_devs > published.estimate.std_devs).all()  # the residual is not white


def test_prediction_is_as_good_as_the_fit(model: Model, log: Log, published: FitResult) -> None:
    (validation,) = validate(published.model, [log], AUTHORS)
    assert validation.relative_error == pytest.approx(published.estimate.relative_error, rel=1e-9)
    assert np.isnan(validation.noise_floor).all()  # not periodic: nothing to compare
