"""From a table (CSV, Parquet or MAT file) and its column map to a log."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_identification.data.column_map import Column, ColumnMap
from crane_identification.data.columns import Columns, read_columns
from crane_identification.data.log import Log, Signal
from crane_identification.data.units import COUNTS
from crane_model.errors import DataError

NANOSECONDS = 1e9


def read_table(path: Path | str, column_map: ColumnMap, joints: Sequence[str]) -> Log:
    """The signals of `joints` in a table. `DataError` names file, column and remedy."""
    path = Path(path)
    if unknown := [joint for joint in joints if joint not in column_map.joints]:
        raise DataError(
            f"{path}: the column map has no joint '{unknown[0]}'; it has "
            f"{', '.join(column_map.joints)}; add it, or rename the joints of the model"
        )
    of_joint = [column_map.joints[joint].given() for joint in joints]
    shared = column_map.shared()
    timing = [column_map.time] if column_map.time else []
    wanted = [*timing, *shared.values(), *(column for one in of_joint for column in one.values())]
    names = dict.fromkeys(column.column for column in wanted)
    table = read_columns(path, names, column_map.separator)
    start, time = _time(path, column_map, table)
    given = [
        (f"{name} of {joint}", c)
        for joint, one in zip(joints, of_joint, strict=True)
        for name, c in one.items()
    ]
    raw = tuple(
        f"{name.replace('_', ' ')} ({column.column})"
        for name, column in (*given, *shared.items())
        if column.quantity == COUNTS
    )

    def matrix(quantity: str) -> Signal:
        columns = [one[quantity] for one in of_joint]
        value = np.column_stack([_values(table, column) for column in columns])
        return Signal(time, value, f"column {', '.join(one.column for one in columns)}")

    def matrix_if_given(quantity: str) -> Signal | None:
        return matrix(quantity) if quantity in of_joint[0] else None

    def vector_if_given(quantity: str) -> Signal | None:
        if quantity not in shared:
            return None
        column = shared[quantity]
        return Signal(time, _values(table, column), f"column {column.column}")

    return Log(
        source=str(path),
        joints=tuple(joints),
        start=start,
        position=matrix("position"),
        velocity=matrix_if_given("velocity"),
        force=matrix_if_given("force"),
        pressure_a=matrix_if_given("pressure_a"),
        pressure_b=matrix_if_given("pressure_b"),
        command=matrix_if_given("command"),
        supply_pressure=vector_if_given("supply_pressure"),
        tank_pressure=vector_if_given("tank_pressure"),
        slew_position=vector_if_given("slew_position"),
        temperature=vector_if_given("temperature"),
        notes=(f"{', '.join(raw)}: in counts, and so is what follows from them",) if raw else (),
        uncalibrated=raw,
    )


def _values(table: Columns, column: Column) -> np.ndarray:
    return column.in_si(table[column.column])


def _time(path: Path, column_map: ColumnMap, table: Columns) -> tuple[int, np.ndarray]:
    """The first stamp [ns], and the time since then [s]."""
    column = column_map.time
    if column is None:
        assert column_map.rate is not None  # the map has one of the two
        rows = len(next(iter(table.values())))
        return 0, np.arange(rows) / column_map.rate
    time = _values(table, column)
    backward = np.flatnonzero(~(np.diff(time) > 0))
    if len(backward):
        row = backward[0] + 1
        raise DataError(
            f"{path}: column '{column.column}', row {row + 1}: time {time[row]} s does not follow "
            f"{time[row - 1]} s; remove repeated rows, or give the rate instead of time"
        )
    return round(time[0] * NANOSECONDS), time - time[0]
