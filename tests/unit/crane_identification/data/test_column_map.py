from pathlib import Path

import numpy as np
import pytest
from scipy import constants

from crane_identification import ColumnMap
from crane_identification.data.column_map import UNITS, Column
from crane_model import ConfigurationError
from crane_model.configuration import load

AXIS = "joints: {axis: {position: {column: x, unit: m}, force: {column: f, unit: N}}}\n"


def test_scale_and_offset_come_before_the_unit() -> None:
    """An encoder of 4096 counts a turn, with zero at count 100."""
    column = Column(column="counts", unit="deg", scale=360 / 4096, offset=-100 * 360 / 4096)
    counts = np.array([100.0, 100 + 1024])
    np.testing.assert_allclose(column.in_si(counts), [0.0, np.pi / 2])


def test_sizes_of_the_units() -> None:
    assert UNITS["deg"].factor == constants.degree
    assert UNITS["rpm"].factor == pytest.approx(2 * constants.pi / constants.minute)
    assert UNITS["bar"].factor == constants.bar
    assert UNITS["psi"].factor == pytest.approx(constants.psi)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: {}\nrate: 10\n", "key 'joints'"),
        (AXIS, "give either a time column or the sampling rate"),
        (AXIS + "rate: 10\ntime: {column: t, unit: s}\n", "give either a time column or the samp"),
        (AXIS + "rate: 0\n", "key 'rate': .*greater than 0.*got 0"),
        (AXIS + "time: {column: t, unit: m}\n", "key 'time'.* 'm' measures length; use .*'ms'"),
        (AXIS + "time: {column: t, unit: s, file: a.csv}\n", "key 'time'.*take out file"),
        (AXIS + "time: {column: t, unit: ISO 8601, scale: 2}\n", "have neither scale nor offset"),
        (AXIS + "rate: 10\nslew: {column: q1, unit: rad}\n", "key 'slew'"),
        (AXIS.replace("unit: m}", "unit: feet}") + "rate: 10\n", "unknown unit 'feet'; use one"),
        (AXIS.replace("x, unit: m", "x") + "rate: 10\n", "position.unit': is required"),
        (AXIS.replace("unit: m}", "unit: bar}") + "rate: 10\n", "'bar' measures pressure"),
        (AXIS.replace("unit: N", "unit: N m") + "rate: 10\n", "force in 'N m' does not fit a pos"),
        (AXIS.replace("unit: N", "unit: N, scale: 0") + "rate: 10\n", "scale must not be 0"),
        (AXIS.replace("force", "pressure_a").replace("N", "bar") + "rate: 10\n", "only of use tog"),
        (AXIS.replace(", force: {column: f, unit: N}", "") + "rate: 10\n", "either force, or pres"),
    ],
)
def test_mistakes_name_file_key_and_remedy(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "columns.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message) as error:
        load(path, ColumnMap)
    assert str(path) in str(error.value)


def test_quantity_of_one_joint_only(tmp_path: Path) -> None:
    path = tmp_path / "columns.yaml"
    path.write_text(
        "rate: 10\n"
        "joints:\n"
        "  a: {position: {column: a, unit: m}, force: {column: f, unit: N}}\n"
        "  b:\n"
        "    position: {column: b, unit: m}\n"
        "    force: {column: g, unit: N}\n"
        "    velocity: {column: v, unit: m/s}\n"
    )
    with pytest.raises(ConfigurationError, match="velocity: given for only one of the joints 'a'"):
        load(path, ColumnMap)
