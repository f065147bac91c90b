"""A bus log to a table of every signal, or to a bag of the crane's topics."""

import shutil
from pathlib import Path

import polars as pl

from crane_bags.writer import BagWriter
from crane_driver.can.binding import load_layout
from crane_driver.can.bus_log import BusLog
from crane_driver.can.dbc import load_dbc
from crane_driver.can.layout import Layout
from crane_driver.can.log_bag import LogBag
from crane_driver.can.log_formats import open_log
from crane_driver.can.log_report import describe
from crane_driver.can.log_table import LogTable
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.progress_bar import progress_bar

TABLES = (".csv", ".parquet")


def decode(
    log_path: Path,
    machine: Machine,
    dbc: Path,
    mapping: Path | None,
    channel: str | None,
    out: Path,
) -> str:
    """Decode a log to `out`, and say what was in it.

    A bag needs the `mapping`; `channel` is needed where the log has several. `DataError` and
    `ConfigurationError` name file, limit and remedy.
    """
    if out.suffix not in TABLES and mapping is None:
        raise ConfigurationError(
            f"{out}: a bag needs --mapping, which says what the signals mean: no common ROS "
            f"message holds signals by name; or name a table, {' or '.join(TABLES)}"
        )
    log, table = open_log(log_path, channel), LogTable(load_dbc(dbc))
    if out.suffix in TABLES:
        _read(log, table, None)
        _write(table.table(), out)
        return describe(log, table)
    assert mapping is not None  # checked above
    bag = _write_bag(log, table, load_layout(machine, mapping, dbc, listen_only=True), out)
    return "\n".join([describe(log, table), *_describe_bag(out, bag)])


def _write_bag(log: BusLog, table: LogTable, layout: Layout, path: Path) -> LogBag:
    writer = BagWriter(path)  # refuses a folder that exists
    try:
        with writer:
            bag = LogBag(writer, layout)
            _read(log, table, bag)
            bag.finish()
            if not bag.written:
                raise DataError(f"{log.path}: its frames make no message; is it of this machine?")
    except DataError:
        shutil.rmtree(path)
        raise
    return bag


def _write(table: pl.DataFrame, path: Path) -> None:
    try:
        if path.suffix == ".csv":
            table.write_csv(path)
        else:
            table.write_parquet(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror or error}") from None


def _read(log: BusLog, table: LogTable, bag: LogBag | None) -> None:
    with progress_bar(log.path.name, log.path.stat().st_size) as bar:
        for frame in log.frames(bar.update):
            table.add(frame)
            if bag:
                bag.add(frame)
    if table.frames == 0:
        raise DataError(
            f"{log.path}: no frame in {log.lines} lines ({log.damaged} of them damaged, "
            f"{log.others} of other channels); name one of its channels, or another log"
        )


def _describe_bag(path: Path, bag: LogBag) -> list[str]:
    lines = [f"{path}: {topic}: {count} messages" for topic, count in bag.written.items()]
    lines += [f"{message}: {count} x {kind}" for (message, kind), count in bag.faults.items()]
    if bag.incomplete:
        lines.append(f"{bag.incomplete} cycles left out: not all of their frames are in the log")
    return lines
