"""Columns of numbers out of CSV, Parquet and MAT files."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import polars as pl
from scipy.io import loadmat

from crane_model.errors import DataError

Columns = dict[str, np.ndarray]


def read_columns(path: Path, names: Collection[str], separator: str = ",") -> Columns:
    """The columns `names` of a table, (n,) floats each; NaN where a cell is empty.

    `separator` is that of text tables (.csv, .tsv, .txt). `DataError` names file, column and
    remedy.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file; check the path")
    try:
        match path.suffix.lower():
            case ".csv" | ".tsv" | ".txt":
                frame = pl.scan_csv(path, separator=separator, infer_schema=False)
                columns = _from_frame(path, frame, names)
            case ".parquet":
                columns = _from_frame(path, pl.scan_parquet(path), names)
            case ".mat":
                columns = _from_mat(path, names)
            case other:
                raise DataError(
                    f"{path}: tables end in .csv, .tsv, .txt, .parquet or .mat, not '{other}'"
                )
    except DataError:
        raise
    except Exception as error:  # a damaged file makes parsers raise anything, not only their own
        raise DataError(f"{path}: not readable: {error}; export the table again") from error
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError(f"{path}: columns differ in length: {lengths}; export them together")
    if not all(lengths.values()):
        raise DataError(f"{path}: the table has no rows; export it again")
    return columns


def _from_frame(path: Path, frame: pl.LazyFrame, names: Collection[str]) -> Columns:
    header = {name.strip(): name for name in frame.collect_schema().names()}
    _require(path, names, header)
    table = frame.select(pl.col(header[name]).alias(name) for name in names).collect()
    return {name: _numbers(path, table[name]) for name in names}


def _numbers(path: Path, column: pl.Series) -> np.ndarray:
    if column.dtype == pl.String:
        column = column.str.strip_chars().replace("", None)
    numbers = column.cast(pl.Float64, strict=False)
    wrong = (numbers.is_null() & column.is_not_null()).arg_true()
    if len(wrong):
        row = wrong[0]
        raise DataError(
            f"{path}: column '{column.name}', row {row + 1}: not a number: {column[row]!r}; "
            "correct the table, or the separator in the column map"
        )
    return numbers.fill_null(np.nan).to_numpy()


def _from_mat(path: Path, names: Collection[str]) -> Columns:
    try:
        content = loadmat(path)
    except NotImplementedError:  # scipy reads the format of MATLAB up to version 7
        raise DataError(f"{path}: MAT file of version 7.3; save it with '-v7'") from None
    _require(path, names, [name for name in content if not name.startswith("__")])
    return {name: _vector(path, name, content[name]) for name in names}


def _vector(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind not in "biuf" or array.size != max(array.shape, default=0):
        raise DataError(
            f"{path}: variable '{name}' is {array.dtype} of shape {array.shape}; save it as a "
            "numeric vector"
        )
    return array.astype(float).ravel()


def _require(path: Path, names: Collection[str], present: Collection[str]) -> None:
    if absent := [name for name in names if name not in present]:
        raise DataError(
            f"{path}: no column '{absent[0]}'; it has {', '.join(present)}; correct the column map "
            "(names, separator)"
        )
