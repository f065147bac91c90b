"""Measured data of a real machine through its column map."""

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from crane_identification import ColumnMap
from crane_identification.data.resample import resample
from crane_identification.data.table_log import read_table
from crane_model.configuration import load

COLUMNS = Path(__file__).with_name("emps_columns.yaml")


def test_emps_comes_through_unchanged(real_data: Path) -> None:
    path = real_data / "emps" / "DATA_EMPS.mat"
    log = read_table(path, load(COLUMNS, ColumnMap), ["axis"])
    samples = resample(log)
    raw = loadmat(path)
    assert samples.rate == 1000.0
    assert len(samples) == 24_841
    assert (samples.run == 0).all()
    np.testing.assert_array_equal(samples.position, raw["qm"])
    np.testing.assert_array_equal(samples.force, 35.15065 * raw["vir"])
    np.testing.assert_allclose(samples.time, raw["t"].ravel(), atol=1e-7)
    assert samples.pressure_a is samples.velocity is samples.command is None
