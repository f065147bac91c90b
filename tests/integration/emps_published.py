"""EMPS as its authors publish it: Janot, Gautier, Brunot (2019), data set and reference models."""

from collections.abc import Sequence
from pathlib import Path

from crane_identification import ColumnMap, Covariance, Log, Options
from crane_identification.data.table_log import read_table
from crane_identification.signals.routes import ButterworthDifferentiator
from crane_model.configuration import load, packaged

FILES = packaged("crane_benchmark", "emps/model.yaml").parent
NAMES = ("inertia.axis", "f_v.axis", "f_c.axis", "offset.axis")
VALUES = (95.1089, 203.5034, 20.3935, -3.1648)
STD_DEVS = (0.1085, 1.146, 0.1012, 0.0444)
RELATIVE_ERROR = 0.040834
CONDITION_NUMBER = 25.9883
PROCESSING = Options(
    motion=ButterworthDifferentiator(cutoff=100.0, order=4),
    average=False,
    trim=(49, 0),
    mask_reversals=False,
    decimation=10,
    covariance=Covariance.SAMPLE,
)


def recording(real_data: Path, joints: Sequence[str]) -> Log:
    """The whole of it."""
    columns = load(FILES / "columns.yaml", ColumnMap)
    return read_table(real_data / "emps" / "DATA_EMPS.mat", columns, joints)
