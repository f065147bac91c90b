"""Tables as loggers and spreadsheets of all kinds write them."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from scipy.io import savemat

from crane_identification import ColumnMap, Log, read_recording
from crane_identification.data.table_log import read_table
from crane_model import CraneError

AXIS = "joints: {axis: {position: {column: x, unit: mm}, force: {column: f, unit: N}}}\n"
PLAIN = "time: {column: t, unit: s}\n" + AXIS
PARTS = """
time: {column: t, unit: s}
joints:
  axis:
    position: {column: x, unit: mm, file: position.csv}
    pressure_a: {column: a, unit: Pa, file: "side_a_*.csv"}
    pressure_b: {column: b, unit: Pa, file: position.csv}
    cylinder: {area_a: 1, area_b: 1}
"""


def mapped(text: str) -> ColumnMap:
    return ColumnMap.model_validate(yaml.safe_load(text))


def read(path: Path, text: str, columns: str = PLAIN) -> Log:
    path.write_text(text, encoding="utf-8")
    return read_table(path, mapped(columns), ["axis"])


def check(log: Log, time: list[float], millimetres: list[float], force: list[float]) -> None:
    assert log.force is not None
    np.testing.assert_allclose(log.position.time, time, atol=1e-12)
    np.testing.assert_allclose(log.position.value[:, 0], np.array(millimetres) / 1e3)
    np.testing.assert_allclose(log.force.value[:, 0], force)


@pytest.mark.parametrize("end", ["\n\n", "\n\n\n  \n", "\n,,\n", "\n , \n\n"])
def test_blank_lines_at_the_end(end: str, tmp_path: Path) -> None:
    text = "t,x,f\n0,1,10\n0.1,2,20"
    check(read(tmp_path / "a.csv", text + end), [0, 0.1], [1, 2], [10, 20])
    by_rate = read(tmp_path / "b.csv", text + end, "rate: 10\n" + AXIS)
    check(by_rate, [0, 0.1], [1, 2], [10, 20])


@pytest.mark.parametrize(
    ("encoding", "end"), [("utf-16", "\r\n"), ("utf-16", "\n"), ("utf-8", "\r")]
)
def test_texts_of_any_spreadsheet(encoding: str, end: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(end.join(["t,x,f", "0,1,10", "0.1,2,20", ""]).encode(encoding))
    check(read_table(path, mapped(PLAIN), ["axis"]), [0, 0.1], [1, 2], [10, 20])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,x,f\n0,1,5,10\n0.1,2,6,20\n", "two columns are called 'x'; rename one"),
        ("t,x,f\n0,1,10\n0.1,2,20,5\n", "a row has more fields than the header; correct the row"),
    ],
)
def test_a_table_that_does_not_fit_its_header(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CraneError, match=message):
        read(tmp_path / "a.csv", text)


def test_a_blank_line_between_stamped_rows_holds_nothing(tmp_path: Path) -> None:
    log = read(tmp_path / "a.csv", "t,x,f\n0,1,10\n\n0.1,2,20\n")
    check(log, [0, 0.1], [1, 2], [10, 20])


def test_with_a_rate_a_blank_line_is_a_lost_sample(tmp_path: Path) -> None:
    log = read(tmp_path / "a.csv", "t,x,f\n0,1,10\n\n0.1,2,20\n", "rate: 10\n" + AXIS)
    check(log, [0, 0.1, 0.2], [1, np.nan, 2], [10, np.nan, 20])


def test_a_row_without_its_time_is_named_by_its_place_in_the_file(tmp_path: Path) -> None:
    with pytest.raises(CraneError, match=r"a.csv: column 't', row 4: time nan \[s\] does not foll"):
        read(tmp_path / "a.csv", "t,x,f\n0,1,10\n\n0.1,2,20\n,3,30\n")


@pytest.mark.parametrize(
    ("times", "remedy"),
    [
        ((0, 0.1, 0.1, 0.2), "remove repeated rows"),
        (
            (8, 8.1, 7.9, 8.0),
            r"goes back 1 time, by up to 0\.2 s: sort the rows, split the table",
        ),
        ((9000, 5400, 5401, 1801), r"time goes back 2 times, by up to 3600 s: sort the rows"),
    ],
)
def test_a_clock_that_is_set_back_is_no_repeated_row(
    times: tuple[float, ...], remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(CraneError, match=remedy):
        read(tmp_path / "a.csv", "t,x,f\n" + "".join(f"{time},1,2\n" for time in times))


def test_decimal_comma(tmp_path: Path) -> None:
    columns = PLAIN + "separator: ';'\ndecimal: ','\n"
    log = read(tmp_path / "a.csv", "t;x;f\n0;1,5;-1,25e1\n0,1;2;20,0\n", columns)
    check(log, [0, 0.1], [1.5, 2], [-12.5, 20])


def test_a_decimal_comma_that_the_map_does_not_know_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CraneError, match="not a number: '0,1'.*decimal in the column map"):
        read(tmp_path / "a.csv", "t;x;f\n0;1;2\n0,1;2;20,0\n", PLAIN + "separator: ';'\n")
    with pytest.raises(ValueError, match="separator and decimal are both ','"):
        mapped(PLAIN + "decimal: ','\n")


def test_names_in_the_encoding_of_windows(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("t,Weg [µm],f\n0,1,10\n1,2,20\n".encode("cp1252"))
    log = read_table(path, mapped(PLAIN.replace("column: x", "column: 'Weg [µm]'")), ["axis"])
    check(log, [0, 1], [1, 2], [10, 20])


DATES = PLAIN.replace("unit: s", "unit: ISO 8601")


@pytest.mark.parametrize(
    ("stamps", "start"),
    [
        (["2026-05-04T09:30:00.25", "2026-05-04T09:30:00.35"], 1777887000_250_000_000),
        (["2026-05-04 09:30:00.250000", "2026-05-04 09:30:00.350000"], 1777887000_250_000_000),
        (["2026-05-04T11:30:00.25+02:00", "2026-05-04T09:30:00.35Z"], 1777887000_250_000_000),
        (["09:30:00.25", "09:30:00.35"], 34200_250_000_000),
        (["20260504T093000.250", "20260504T093000.350"], 1777887000_250_000_000),
    ],
)
def test_times_of_iso_8601(stamps: list[str], start: int, tmp_path: Path) -> None:
    log = read(tmp_path / "a.csv", f"t,x,f\n{stamps[0]},1,10\n{stamps[1]},2,20\n\n", DATES)
    check(log, [0, 0.1], [1, 2], [10, 20])
    assert log.start == start


def test_dates_of_parquet(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    stamps = pl.Series("t", [1777887000_250, 1777887000_350]).cast(pl.Datetime("ms"))
    pl.DataFrame({"t": stamps, "x": [1.0, 2.0], "f": [10.0, 20.0]}).write_parquet(path)
    log = read_table(path, mapped(DATES), ["axis"])
    check(log, [0, 0.1], [1, 2], [10, 20])
    assert log.start == 1777887000_250_000_000
    with pytest.raises(CraneError, match=r"holds dates \(Datetime.*with the unit ISO 8601"):
        read_table(path, mapped(PLAIN), ["axis"])


def test_a_text_that_is_no_time(tmp_path: Path) -> None:
    with pytest.raises(CraneError, match="row 2: not a time of ISO 8601: '4.5.2026 9:30'"):
        read(tmp_path / "a.csv", "t,x,f\n2026-05-04T09:30:00,1,1\n4.5.2026 9:30,2,2\n", DATES)


NESTED = """
time: {column: log.t, unit: s}
joints:
  axis:
    position: {column: log.joint.1.x, unit: mm}
    force: {column: log.forces, index: 1, unit: N}
"""


def nested(path: Path) -> Path:
    joints = np.array([{"x": np.array([9.0, 9.0])}, {"x": np.array([1.0, 2.0])}], dtype=object)
    forces = np.array([[0.0, 10.0], [0.0, 20.0]])
    savemat(path, {"log": {"t": np.array([0.0, 0.1]), "joint": joints, "forces": forces}})
    return path


def test_structs_and_matrices_of_mat_files(tmp_path: Path) -> None:
    log = read_table(nested(tmp_path / "a.mat"), mapped(NESTED), ["axis"])
    check(log, [0, 0.1], [1, 2], [10, 20])


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("log.t", "log.time", "no column 'time'; 'log' has t, joint, forces"),
        ("log.t", "logs.t", "no column 'logs'; it has log"),
        ("joint.1.x", "joint.2.x", "'log.joint' has no '2'; it is an array of 2 structs, 0 to 1"),
        ("joint.1.x", "joint.1", "'log.joint.1' is a struct with x; name a numeric vector"),
        ("index: 1", "index: 2", r"float64 of shape \(2, 2\); .*index of a column that it has"),
    ],
)
def test_what_a_mat_file_has_instead(right: str, wrong: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CraneError, match=message):
        read_table(nested(tmp_path / "a.mat"), mapped(NESTED.replace(right, wrong)), ["axis"])


def test_a_folder_of_tables_is_one_recording(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for number in (9, 10, 11):  # not the order of the letters
        (folder / f"log_{number}.csv").write_text(f"t,x,f\n{number},{number},{10 * number}\n\n")
    log = read_recording(folder, ["axis"], mapped(PLAIN))
    check(log, [0, 1, 2], [9, 10, 11], [90, 100, 110])
    with pytest.raises(CraneError, match="3 tables, log_9.csv to log_11.csv, and no time"):
        read_recording(folder, ["axis"], mapped("rate: 10\n" + AXIS))
    with pytest.raises(CraneError, match="needs a column map"):
        read_recording(folder, ["axis"], None)


def test_files_of_a_folder_that_hold_different_signals(tmp_path: Path) -> None:
    """Each keeps its own time; what is computed from several has the time of the first."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "side_a_1.csv").write_text("t,a\n99.95,0\n100.05,10\n")
    (folder / "side_a_2.csv").write_text("t,a\n100.15,30\n100.5,30\n")
    (folder / "position.csv").write_text("t,x,b\n100,1,0\n100.1,2,-1\n100.2,3,-2\n")
    log = read_table(folder, mapped(PARTS), ["axis"])
    np.testing.assert_allclose(log.position.value[:, 0], [1e-3, 2e-3, 3e-3])
    assert log.start == 100_000_000_000
    assert log.force is not None
    np.testing.assert_allclose(log.force.time, [-0.05, 0.05, 0.15, 0.5])
    np.testing.assert_allclose(log.force.value[:, 0], [np.nan, 10.5, 31.5, np.nan])
    with pytest.raises(CraneError, match="no table 'place.csv'; there are position.csv, side_a_1"):
        read_table(folder, mapped(PARTS.replace("position.csv", "place.csv")), ["axis"])


def test_files_that_are_named_need_a_folder(tmp_path: Path) -> None:
    with pytest.raises(CraneError, match="names the file 'position.csv' of a folder; give the f"):
        read(tmp_path / "a.csv", "t,x,f\n0,1,10\n", PARTS)


def test_sums_differences_and_a_reference(tmp_path: Path) -> None:
    columns = """
time: {column: t, unit: s}
joints:
  axis:
    position: {column: x, unit: mm}
    reference_position: {column: r, unit: m}
    force:
      sum:
        - {column: motor, unit: kN}
        - {column: spring, unit: N, scale: -2}
"""
    log = read(tmp_path / "a.csv", "t,x,r,motor,spring\n0,1,3,1,100\n1,2,4,2,200\n", columns)
    check(log, [0, 1], [1, 2], [800, 1600])
    assert log.force is not None
    assert log.force.origin == "column motor - spring"
    assert log.reference_position is not None
    np.testing.assert_allclose(log.reference_position.value[:, 0], [3, 4])
    with pytest.raises(ValueError, match="a sum of different quantities, in kN, bar"):
        mapped(columns.replace("spring, unit: N", "spring, unit: bar"))


CYLINDER = """
rate: 10
joints:
  axis:
    position: {column: x, unit: mm}
    pressure_a: {column: a, unit: bar}
    pressure_b: {column: b, unit: bar}
    cylinder: {area_a: 0.01, area_b: 0.004}
"""


def test_a_cylinder_of_ones_own(tmp_path: Path) -> None:
    table = "x,a,b\n1,10,5\n2,20,50\n"
    log = read(tmp_path / "a.csv", table, CYLINDER)
    check(log, [0, 0.1], [1, 2], [8e3, 0])
    assert log.pressure_b is not None
    np.testing.assert_allclose(log.pressure_b.value[:, 0], [5e5, 50e5])
    plunger = CYLINDER.replace(", area_b: 0.004", "").replace(
        "    pressure_b: {column: b, unit: bar}\n", ""
    )
    check(read(tmp_path / "b.csv", table, plunger), [0, 0.1], [1, 2], [1e4, 2e4])


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("area_a: 0.01, area_b: 0.004", "", "area_a, area_b or both must be above 0"),
        ("pressure_b: {column: b, unit: bar}", "", "area_b needs pressure_b"),
        ("a, unit: bar", "a, unit: counts", "needs pressure_a in a unit of pressure"),
        ("cylinder", "force: {column: f, unit: N}\n    cylinder", "both say what the force is"),
    ],
)
def test_cylinders_that_say_too_little_or_too_much(right: str, wrong: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        mapped(CYLINDER.replace(right, wrong))


@pytest.mark.parametrize("source", ["{unit: mm}", "x", "{column: x, topic: /x, unit: mm}"])
def test_a_source_is_of_one_kind(source: str) -> None:
    with pytest.raises(ValueError, match="needs one of the keys column"):
        mapped(PLAIN.replace("{column: x, unit: mm}", source))
