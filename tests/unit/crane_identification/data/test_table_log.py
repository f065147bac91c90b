from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from crane_identification import ColumnMap, Log
from crane_identification.data.table_log import read_table
from crane_model import DataError

JOINTS = ("boom", "stick")
TABLE = {
    "t_ms": np.array([5000.0, 5010.0, 5020.0, 5030.0]),
    "q_boom": np.array([0.0, 90.0, 180.0, -90.0]),
    "q_stick": np.array([0.0, 1000.0, 2000.0, np.nan]),
    "pa_boom": np.array([1.0, 2.0, 3.0, 4.0]),
    "pb_boom": np.array([5.0, 6.0, 7.0, 8.0]),
    "pa_stick": np.array([10.0, 20.0, 30.0, 40.0]),
    "pb_stick": np.array([50.0, 60.0, 70.0, 80.0]),
    "oil": np.array([300.0, 301.0, 302.0, 303.0]),
    "slew": np.array([0.1, 0.2, 0.3, 0.4]),
    "ps": np.array([175.0, 175.0, 175.0, 175.0]),
}


def joint_columns(joint: str, unit: str) -> dict[str, dict[str, str]]:
    return {
        "position": {"column": f"q_{joint}", "unit": unit},
        "pressure_a": {"column": f"pa_{joint}", "unit": "bar"},
        "pressure_b": {"column": f"pb_{joint}", "unit": "bar"},
    }


def column_map(**changes: object) -> ColumnMap:
    content = {
        "time": {"column": "t_ms", "unit": "ms"},
        "joints": {"boom": joint_columns("boom", "deg"), "stick": joint_columns("stick", "mm")},
        "temperature": {"column": "oil", "unit": "deg C", "offset": -273.15},
        "slew_position": {"column": "slew", "unit": "rad"},
        "supply_pressure": {"column": "ps", "unit": "bar"},
    }
    return ColumnMap.model_validate(content | changes)


def write(path: Path, table: dict[str, np.ndarray] = TABLE) -> Path:
    if path.suffix == ".mat":
        savemat(path, table, oned_as="column")
        return path
    frame = pl.DataFrame(table).fill_nan(None)
    if path.suffix == ".parquet":
        frame.write_parquet(path)
    else:
        frame.write_csv(path, separator="\t" if path.suffix == ".tsv" else ",")
    return path


def check(log: Log) -> None:
    nan = np.nan
    np.testing.assert_allclose(log.position.time, [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(
        log.position.value, [[0, 0], [np.pi / 2, 1], [np.pi, 2], [-np.pi / 2, nan]]
    )
    assert log.pressure_a is not None
    assert log.pressure_b is not None
    assert log.temperature is not None
    assert log.slew_position is not None
    assert log.supply_pressure is not None
    np.testing.assert_allclose(
        log.pressure_a.value, [[1e5, 1e6], [2e5, 2e6], [3e5, 3e6], [4e5, 4e6]]
    )
    np.testing.assert_allclose(log.pressure_b.value[:, 1], [50e5, 60e5, 70e5, 80e5])
    np.testing.assert_allclose(log.temperature.value, [26.85, 27.85, 28.85, 29.85])
    np.testing.assert_allclose(log.slew_position.value, TABLE["slew"])
    np.testing.assert_allclose(log.supply_pressure.value, 175e5)
    assert log.force is log.velocity is log.command is log.tank_pressure is None
    assert log.joints == JOINTS
    assert log.start == 5_000_000_000


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_every_format(suffix: str, tmp_path: Path) -> None:
    check(read_table(write(tmp_path / f"table{suffix}"), column_map(), JOINTS))


def test_tabs(tmp_path: Path) -> None:
    check(read_table(write(tmp_path / "table.tsv"), column_map(separator="\t"), JOINTS))


def test_spaces_and_a_ragged_end(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    rows = [", ".join(str(cell) for cell in row) for row in zip(*TABLE.values(), strict=True)]
    rows[0] += ", first"
    lines = [", ".join(TABLE) + ", remark", *rows]
    path.write_text("\n".join(lines).replace("nan", "") + "\n")
    check(read_table(path, column_map(), JOINTS))


def test_joints_in_the_order_of_the_model(tmp_path: Path) -> None:
    log = read_table(write(tmp_path / "table.csv"), column_map(), ["stick"])
    assert log.joints == ("stick",)
    assert log.position.value.shape == (4, 1)
    log = read_table(write(tmp_path / "table.csv"), column_map(), ["stick", "boom"])
    np.testing.assert_allclose(log.position.value[1], [1.0, np.pi / 2])


def test_rate_instead_of_time(tmp_path: Path) -> None:
    log = read_table(write(tmp_path / "table.csv"), column_map(time=None, rate=4.0), JOINTS)
    assert log.position.time.tolist() == [0.0, 0.25, 0.5, 0.75]
    assert log.start == 0


def test_optional_columns_of_the_joints(tmp_path: Path) -> None:
    table = {
        "x": np.array([1, 2, 3]),
        "f": np.array([0.5, 1.0, 1.5]),
        "v": np.array([10, 20, 30]),
        "u": np.array([-100, 0, 50]),
    }
    columns = {
        "position": {"column": "x", "unit": "m"},
        "force": {"column": "f", "unit": "kN", "scale": 2.0},
        "velocity": {"column": "v", "unit": "mm/s"},
        "command": {"column": "u", "unit": "%"},
    }
    log = read_table(
        write(tmp_path / "table.mat", table),
        ColumnMap.model_validate({"rate": 10.0, "joints": {"axis": columns}}),
        ["axis"],
    )
    assert log.force is not None
    assert log.velocity is not None
    assert log.command is not None
    np.testing.assert_allclose(log.force.value, [[1000.0], [2000.0], [3000.0]])
    np.testing.assert_allclose(log.velocity.value, [[0.01], [0.02], [0.03]])
    np.testing.assert_allclose(log.command.value, [[-1.0], [0.0], [0.5]])


def refusal(path: Path, joints: tuple[str, ...] = JOINTS, **changes: object) -> str:
    with pytest.raises(DataError) as error:
        read_table(path, column_map(**changes), joints)
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_missing_column(suffix: str, tmp_path: Path) -> None:
    table = {name: values for name, values in TABLE.items() if name != "pa_stick"}
    message = refusal(write(tmp_path / f"table{suffix}", table))
    assert "no column 'pa_stick'; it has t_ms, q_boom" in message
    assert "correct the column map" in message


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x13 nonsense \xfe" * 50])
def test_damaged_file(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"table{suffix}"
    path.write_bytes(content)
    refusal(path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_table_without_rows(suffix: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"table{suffix}", {name: values[:0] for name, values in TABLE.items()})
    assert "has no rows" in refusal(path)


def test_no_such_file(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "absent.csv")


def test_other_format(tmp_path: Path) -> None:
    path = tmp_path / "table.xlsx"
    path.write_text("?")
    assert "tables end in .csv" in refusal(path)


def test_joint_that_the_map_does_not_have(tmp_path: Path) -> None:
    message = refusal(write(tmp_path / "table.csv"), (*JOINTS, "gripper"))
    assert "the column map has no joint 'gripper'; it has boom, stick" in message


def test_cell_that_is_no_number(tmp_path: Path) -> None:
    path = write(tmp_path / "table.csv")
    path.write_text(path.read_text().replace("90.0", "n/a", 1))
    assert "column 'q_boom', row 2: not a number: 'n/a'" in refusal(path)


@pytest.mark.parametrize(
    "stamps", [[0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0], [0.0, np.nan, 2, 3]]
)
def test_time_that_does_not_run_forward(stamps: list[float], tmp_path: Path) -> None:
    table = TABLE | {"t_ms": np.array(stamps)}
    message = refusal(write(tmp_path / "table.csv", table))
    assert "column 't_ms', row" in message
    assert "give the rate instead" in message


def test_mat_columns_of_different_length(tmp_path: Path) -> None:
    message = refusal(write(tmp_path / "table.mat", TABLE | {"oil": np.zeros(3)}))
    assert "columns differ in length" in message


def test_mat_variable_that_is_no_vector(tmp_path: Path) -> None:
    message = refusal(write(tmp_path / "table.mat", TABLE | {"oil": np.zeros((4, 2))}))
    assert "variable 'oil' is float64 of shape (4, 2)" in message


def test_mat_of_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "table.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x00" * 400)
    assert "save it with '-v7'" in refusal(path)


def test_counts_stay_as_they_are_and_are_said(tmp_path: Path) -> None:
    boom = joint_columns("boom", "counts") | {"pressure_a": {"column": "pa_boom", "unit": "counts"}}
    path = write(tmp_path / "table.csv")
    log = read_table(path, column_map(joints={"boom": boom}), ("boom",))
    np.testing.assert_array_equal(log.position.value[:, 0], TABLE["q_boom"])
    assert log.uncalibrated == ("position of boom (q_boom)", "pressure a of boom (pa_boom)")
    assert log.notes == (
        f"{', '.join(log.uncalibrated)}: in counts, and so is what follows from them",
    )
    assert read_table(path, column_map(), JOINTS).uncalibrated == ()


def test_commands_of_two_sides_and_of_a_magnitude_with_a_state(tmp_path: Path) -> None:
    joints = {"boom": joint_columns("boom", "deg"), "stick": joint_columns("stick", "mm")}
    pair = [{"column": name, "unit": "-", "scale": s} for name, s in (("up", 0.25), ("dn", -0.25))]
    state = {"column": "state", "unit": "counts"}
    of_state = {"size": {"column": "flow", "unit": "%"}, "direction": state}
    commands = {"boom": {"sum": pair}, "stick": {**of_state, "positive": 1, "negative": 2}}
    mapped = {joint: {**joints[joint], "command": commands[joint]} for joint in JOINTS}
    sides = {"up": [4.0, 0.0, 0.0, 1.0], "dn": [0.0, 2.0, 0.0, 0.0]}  # MPa
    valve = {"flow": [50.0, 50.0, 100.0, 20.0], "state": [0.0, 1.0, 2.0, 3.0]}
    table = TABLE | {name: np.array(values) for name, values in (sides | valve).items()}
    log = read_table(write(tmp_path / "a.csv", table), column_map(joints=mapped), JOINTS)
    assert log.command is not None
    expected = [[1.0, 0.0], [-0.5, 0.5], [0.0, -1.0], [0.25, 0.0]]
    np.testing.assert_allclose(log.command.value, expected, atol=1e-12)
