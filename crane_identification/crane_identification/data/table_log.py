"""From tables (CSV, Parquet or MAT files) and their column map to a log."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.column_map import DATE, Cell, ColumnMap
from crane_identification.data.columns import Columns, empty_rows, read_columns
from crane_identification.data.log import Log
from crane_identification.data.mapped_log import Stream, mapped_log
from crane_identification.data.table_files import tables_in
from crane_model.errors import ConfigurationError, DataError


def read_table(path: Path | str, column_map: ColumnMap, joints: Sequence[str]) -> Log:
    """The signals of `joints` in a table, or in a folder of tables that are one recording.

    Of a folder, the tables that a column names are read one after the other, as their time says.
    `DataError` and `ConfigurationError` name file, column and remedy.
    """
    path = Path(path)
    if column_map.of_topics:
        raise ConfigurationError(
            f"{path}: the column map is for bags: it names topics; name columns, or give a bag"
        )
    streams = {
        pattern: _stream(_files(path, pattern), column_map, cells)
        for pattern, cells in column_map.cells(joints, path).items()
    }
    return mapped_log(path, column_map, joints, streams)


def _files(path: Path, pattern: str) -> list[Path]:
    if not path.is_dir():
        if pattern == "*":
            return [path]
        raise ConfigurationError(
            f"{path}: the column map names the file '{pattern}' of a folder; give the folder"
        )
    tables = tables_in(path)
    found = [one for one in tables if one.match(pattern)]
    if not found:
        raise DataError(
            f"{path}: no table '{pattern}'; there are {', '.join(one.name for one in tables)}; "
            "correct the column map"
        )
    return found


def _stream(files: Sequence[Path], column_map: ColumnMap, cells: Sequence[Cell]) -> Stream:
    """The columns of tables that follow one another."""
    column = column_map.time
    clock = [column.cell] if column else []
    dates = clock if column and column.unit == DATE else []
    tables = [
        read_columns(file, [*clock, *cells], column_map.separator, column_map.decimal, dates)
        for file in files
    ]
    if column is None:
        assert column_map.rate is not None  # the map has one of the two
        if len(files) > 1:
            raise DataError(
                f"{files[0].parent}: {len(files)} tables, {files[0].name} to {files[-1].name}, and "
                "no time that says how they follow one another; name each as a recording, or give "
                "a time column"
            )
        numbers = _joined(tables)
        return Stream(0, np.arange(len(numbers[cells[0]])) / column_map.rate, numbers)
    kept = [np.flatnonzero(~empty_rows(table)) for table in tables]
    numbers = _joined(
        [
            {cell: values[rows] for cell, values in table.items()}
            for table, rows in zip(tables, kept, strict=True)
        ]
    )
    stamps = numbers[column.cell]
    start, time = _since_start(stamps) if dates else _since_start_in_s(column.in_si(stamps))
    backward = np.flatnonzero(~(np.diff(time) > 0))
    if len(backward):
        number = backward[0] + 1
        places = [(file, row) for file, rows in zip(files, kept, strict=True) for row in rows]
        file, row = places[number]
        raise DataError(
            f"{file}: column '{column.label}', row {row + 1}: time {stamps[number]} "
            f"[{column.unit}] does not follow {stamps[number - 1]}; remove repeated rows, or give "
            "the rate instead of time"
        )
    return Stream(start, time, numbers)


def _joined(tables: Sequence[Columns]) -> Columns:
    return {cell: np.concatenate([table[cell] for table in tables]) for cell in tables[0]}


def _since_start(dates: np.ndarray) -> tuple[int, np.ndarray]:
    """First stamp [ns] and time since then [s]; NaN where there is none."""
    since = dates - dates[0]
    seconds = np.where(np.isnat(since), np.nan, since.astype(np.int64) / NANOSECONDS)
    return int(dates[0].astype(np.int64)), seconds


def _since_start_in_s(seconds: np.ndarray) -> tuple[int, np.ndarray]:
    first = seconds[0] if np.isfinite(seconds[0]) else 0.0
    return round(first * NANOSECONDS), seconds - first
