"""--from and --to of both commands, down to the samples that are read."""

from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.synthetic import RATE, axis_log, axis_model

from crane_identification import ColumnMap, Options, diagnose, identify
from crane_identification.data.sources import Sources
from crane_model import DataError
from crane_model.progress_bar import silent

GIVEN = ["--model", "m", "--train", "a", "--validate", "b", "--out", "c"]
COLUMNS = {
    "rate": RATE,
    "joints": {
        "axis": {"position": {"column": "q", "unit": "m"}, "force": {"column": "f", "unit": "N"}}
    },
}


@pytest.mark.parametrize("command", [identify, diagnose], ids=["identify", "diagnose"])
def test_both_commands_take_the_part(command: object, capsys: pytest.CaptureFixture[str]) -> None:
    parser = command.parser()  # type: ignore[attr-defined]
    whole = parser.parse_args(GIVEN)
    assert (whole.begin, whole.end, whole.period) == (0.0, np.inf, None)
    part = parser.parse_args([*GIVEN, "--from", "0", "--to", "12.5", "--period", "4"])
    assert (part.begin, part.end, part.period) == (0.0, 12.5, 4.0)
    for wrong in (["--from", "-1"], ["--to", "nan"], ["--period", "0"]):
        with pytest.raises(SystemExit):
            parser.parse_args([*GIVEN, *wrong])
        assert f"argument {wrong[0]}: must be a" in capsys.readouterr().err


@pytest.mark.parametrize("command", [identify, diagnose], ids=["identify", "diagnose"])
def test_recordings_may_be_named_one_by_one(command: object) -> None:
    """None that was named is left out without a word."""
    parser = command.parser()  # type: ignore[attr-defined]
    named = parser.parse_args([*GIVEN, "--train", "d", "e", "--validate", "f"])
    assert [str(path) for path in named.train] == ["a", "d", "e"]
    assert [str(path) for path in named.validate] == ["b", "f"]
    assert [str(path) for path in parser.parse_args(GIVEN).train] == ["a"]


def test_what_lies_outside_is_not_read_and_what_is_bad_inside_is_named(tmp_path: Path) -> None:
    model = axis_model(tmp_path)
    log = axis_log(1, model, periods=1)
    assert log.force is not None
    position = log.position.value[:, 0].copy()
    position[[300, 1500]] += 0.05
    table = np.column_stack([position, log.force.value[:, 0]])
    file = tmp_path / "axis.csv"
    np.savetxt(file, table, delimiter=",", header="q,f", comments="")
    columns = ColumnMap.model_validate(COLUMNS)
    (read,) = Sources(model, columns, Options(begin=5.0, end=18.0), silent).read([file])
    assert read.force is not None
    for signal in (read.position, read.force):
        assert (signal.time[0], signal.time[-1]) == pytest.approx((5.0, 18.0), abs=1.5 / RATE)
    (warning,) = read.warnings
    assert warning.startswith(f"{file}: position of axis (column q): 1 sample left out")
    assert "sample 1500 at 15 s" in warning
    with pytest.raises(DataError, match="no position from 99 s to its end; it lasts 23.99 s"):
        Sources(model, columns, Options(begin=99.0), silent).read([file])
