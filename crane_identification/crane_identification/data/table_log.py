"""From tables (CSV, Parquet or MAT files) and their column map to a log."""

import io
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Collection, Sequence
from datetime import UTC, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from scipy.io import loadmat

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.column_map import DATE, TABLES, Cell, ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.recording_log import Stream, mapped_log, tables_in
from crane_model.errors import ConfigurationError, DataError

BEGINNING_BYTES = 4096  # bytes that tell encoding and ends of lines
TWICE = "_duplicated_0"  # ending by which polars tells a second column of one name
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)
DATE_DTYPE = "datetime64[ns]"
NO_DATE = int(np.datetime64("NaT", "us").astype(np.int64))

Columns = dict[Cell, np.ndarray]


def read_columns(
    path: Path,
    cells: Collection[Cell],
    separator: str = ",",
    decimal: str = ".",
    dates: Collection[Cell] = (),
) -> Columns:
    """Columns of a table, (n,) floats each; NaN where a cell is empty.

    Those of `dates` hold ISO 8601 texts, with or without a date, and are datetime64[ns]. Rows at
    the end in which all of these columns are empty are left out. `separator` and `decimal` are
    those of text tables (.csv, .tsv, .txt). `DataError` names file, column and remedy.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file; check the path")
    try:
        match path.suffix.lower():
            case ".csv" | ".tsv" | ".txt":
                frame = pl.scan_csv(_in_utf_8(path), separator=separator, infer_schema=False)
                columns = _from_frame(path, frame, cells, decimal, dates)
            case ".parquet":
                columns = _from_frame(path, pl.scan_parquet(path), cells, decimal, dates)
            case ".mat":
                columns = _from_mat(path, cells, dates)
            case other:
                raise DataError(
                    f"{path}: tables end in {', '.join(TABLES[:-1])} or {TABLES[-1]}, not '{other}'"
                )
    except DataError:
        raise
    except pl.exceptions.ComputeError as error:
        if "found more fields" not in str(error):
            raise DataError(f"{path}: not readable: {error}; export the table again") from error
        raise DataError(
            f"{path}: a row has more fields than the header; correct the row, or the separator in "
            "the column map"
        ) from error
    except Exception as error:  # a damaged file makes parsers raise anything, not only their own
        raise DataError(f"{path}: not readable: {error}; export the table again") from error
    lengths = {name: len(values) for (name, _), values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError(f"{path}: columns differ in length: {lengths}; export them together")
    columns = _without_empty_end(columns)
    if not all(len(values) for values in columns.values()):
        raise DataError(f"{path}: the table has no rows; export it again")
    return columns


def _in_utf_8(path: Path) -> Path | io.BytesIO:
    """A text table, or its content as the parser needs it: in UTF-8, with an end of line."""
    with path.open("rb") as file:
        beginning = file.read(BEGINNING_BYTES)
    encoding = "utf-16" if beginning.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8"
    if encoding == "utf-8" and (b"\n" in beginning or b"\r" not in beginning):
        return path
    text = path.read_text(encoding, errors="surrogateescape")  # which ends lines with \n
    return io.BytesIO(text.encode(errors="surrogateescape"))


def empty_rows(columns: Columns) -> np.ndarray:
    """(n,) where no column holds anything."""
    empty = [
        np.isnat(column) if column.dtype.kind == "M" else np.isnan(column)
        for column in columns.values()
    ]
    return np.logical_and.reduce(empty)


def _without_empty_end(columns: Columns) -> Columns:
    filled = np.flatnonzero(~empty_rows(columns))
    end = filled[-1] + 1 if len(filled) else 0
    return {cell: values[:end] for cell, values in columns.items()}


def _from_frame(
    path: Path, frame: pl.LazyFrame, cells: Collection[Cell], decimal: str, dates: Collection[Cell]
) -> Columns:
    header = {name.strip(): name for name in frame.collect_schema().names()}
    header |= {name: header[_misread(name)] for name, _ in cells if _misread(name) in header}
    _require(path, [name for name, _ in cells], header)
    if twice := next((name for name, _ in cells if f"{header[name]}{TWICE}" in header), None):
        raise DataError(f"{path}: two columns are called '{twice}'; rename one of them")
    if matrix := next((name for name, index in cells if index is not None), None):
        raise DataError(
            f"{path}: column '{matrix}': index is for matrices in MAT files; take it out of the "
            "column map"
        )
    table = frame.select(pl.col(header[name]).alias(name) for name, _ in cells).collect()
    return {
        (name, _): (
            _dates(path, table[name])
            if (name, _) in dates
            else _numbers(path, table[name], decimal)
        )
        for name, _ in cells
    }


def _misread(name: str) -> str:
    """A name out of a file in the encoding of Windows, as the parser of UTF-8 gives it."""
    return name.encode("cp1252", "replace").decode("utf-8", "replace")


def _numbers(path: Path, column: pl.Series, decimal: str) -> np.ndarray:
    if column.dtype.is_temporal():
        raise DataError(
            f"{path}: column '{column.name}' holds dates ({column.dtype}); only time can be "
            "dates, with the unit ISO 8601"
        )
    text = _stripped(column)
    plain = text.str.replace(decimal, ".", literal=True) if text.dtype == pl.String else text
    numbers = plain.cast(pl.Float64, strict=False)
    wrong = (numbers.is_null() & text.is_not_null()).arg_true()
    if len(wrong):
        row = wrong[0]
        raise DataError(
            f"{path}: column '{column.name}', row {row + 1}: not a number: {column[row]!r}; "
            "correct the table, or separator and decimal in the column map"
        )
    return numbers.fill_null(np.nan).to_numpy()


def _dates(path: Path, column: pl.Series) -> np.ndarray:
    if column.dtype == pl.Time:
        return column.cast(pl.Int64).to_numpy().astype(DATE_DTYPE)
    if column.dtype.is_temporal():
        return column.cast(pl.Datetime("ns")).to_numpy()
    if column.dtype != pl.String:
        raise DataError(
            f"{path}: column '{column.name}' holds numbers, not dates; give it a unit of time"
        )
    stamps = []
    for row, text in enumerate(_stripped(column)):
        try:
            stamps.append(_microseconds(text))
        except ValueError:
            raise DataError(
                f"{path}: column '{column.name}', row {row + 1}: not a time of ISO 8601: {text!r}; "
                "write 2026-05-04T09:30:00.250, with or without the date"
            ) from None
    return np.array(stamps, "datetime64[us]").astype(DATE_DTYPE)


def _microseconds(text: str | None) -> int:
    """Since 1970, UTC where no time zone is said; since midnight where there is no date."""
    if text is None:
        return NO_DATE
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        stamp = datetime.combine(EPOCH, time.fromisoformat(text))
    return ((stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)) - EPOCH) // MICROSECOND


def _stripped(column: pl.Series) -> pl.Series:
    if column.dtype != pl.String:
        return column
    return column.str.strip_chars().replace("", None)


def _from_mat(path: Path, cells: Collection[Cell], dates: Collection[Cell]) -> Columns:
    if dates:
        raise DataError(f"{path}: times of MAT files are numbers; give the unit of time in seconds")
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # scipy reads the format of MATLAB up to version 7
        raise DataError(f"{path}: MAT file of version 7.3; save it with '-v7'") from None
    variables = {name: variable for name, variable in content.items() if not name.startswith("__")}
    return {cell: _vector(path, *cell, _inside(path, cell[0], variables)) for cell in cells}


def _inside(path: Path, name: str, variables: dict[str, Any]) -> Any:
    """Follow a dotted name through structs and arrays of structs."""
    found: Any = variables
    way = [name] if name in variables else name.split(".")
    for depth, part in enumerate(way):
        if isinstance(found, dict):
            _require(path, [part], found, ".".join(way[:depth]))
            found = found[part]
            continue
        if isinstance(found, np.ndarray) and found.dtype == object:
            found = list(found)
        if not isinstance(found, list) or not part.isdigit() or int(part) >= len(found):
            raise DataError(
                f"{path}: '{'.'.join(way[:depth])}' has no '{part}'; it is {_shown(found)}; "
                "correct the column map"
            )
        found = found[int(part)]
    return found


def _vector(path: Path, name: str, index: int | str | None, value: Any) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "biuf" or isinstance(value, (dict, list)):
        raise DataError(f"{path}: variable '{name}' is {_shown(value)}; name a numeric vector")
    if isinstance(index, int) and array.ndim == 2 and index < array.shape[1]:
        return array[:, index].astype(float)
    if index is not None or array.size != max(array.shape, default=1):
        raise DataError(
            f"{path}: variable '{name}' is {_shown(value)}; save it as a numeric vector, or give "
            "the index of a column that it has, from 0"
        )
    return array.astype(float).ravel()


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return f"a struct with {', '.join(value)}"
    if isinstance(value, list):
        return f"an array of {len(value)} structs, 0 to {len(value) - 1}"
    array = np.asarray(value)
    return f"{array.dtype} of shape {array.shape}"


def _require(
    path: Path, names: Collection[str], present: Collection[str], struct: str = ""
) -> None:
    if absent := [name for name in names if name not in present]:
        where = f"'{struct}' has" if struct else "it has"
        raise DataError(
            f"{path}: no column '{absent[0]}'; {where} {', '.join(present)}; correct the column "
            "map (names, separator)"
        )


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
    found = [table for table in tables if table.match(pattern)]
    if not found:
        raise DataError(
            f"{path}: no table '{pattern}'; there are {', '.join(table.name for table in tables)}; "
            "correct the column map"
        )
    return found


def _stream(files: Sequence[Path], column_map: ColumnMap, cells: Sequence[Cell]) -> Stream:
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
    steps = np.diff(time)
    backward = np.flatnonzero(~(steps > 0))
    if len(backward):
        number = backward[0] + 1
        places = [(file, row) for file, rows in zip(files, kept, strict=True) for row in rows]
        file, row = places[number]
        raise DataError(
            f"{file}: column '{column.label}', row {row + 1}: time {stamps[number]} "
            f"[{column.unit}] does not follow {stamps[number - 1]}; {_order_remedy(steps)}"
        )
    return Stream(start, time, numbers)


def _order_remedy(steps: np.ndarray) -> str:
    """How rows can get the order of their times, whose differences (n,) [s] are not all > 0."""
    back = steps[steps < 0]
    if not len(back):
        return "remove repeated rows, or give the rate instead of time"
    return (
        f"time goes back {len(back)} time{'s' * (len(back) > 1)}, by up to {-back.min():.4g} s: "
        "sort the rows, split the table where the clock was set, or give the rate instead of time"
    )


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
