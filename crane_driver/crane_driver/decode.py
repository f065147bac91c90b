"""crane_driver decode: a bus log to a table of every signal, or to a bag of the crane's topics."""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import polars as pl
from tqdm import tqdm

from crane_driver.bags.writer import BagWriter
from crane_driver.can.binding import load_layout
from crane_driver.can.candump import Log
from crane_driver.can.dbc import load_dbc
from crane_driver.can.layout import Layout
from crane_driver.can.log_bag import LogBag
from crane_driver.can.log_report import describe
from crane_driver.can.log_table import LogTable
from crane_model.cli import run
from crane_model.errors import ConfigurationError, DataError

TABLES = (".csv", ".parquet")


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_driver decode`."""
    parser = argparse.ArgumentParser(prog="decode", description=__doc__)
    parser.add_argument("--dbc", type=Path, required=True, help="DBC file")
    parser.add_argument("--log", type=Path, required=True, help="log as candump -l writes it")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="TABLE.csv or TABLE.parquet: one row a value; any other name: folder of a bag "
        "(mcap), which needs --mapping",
    )
    parser.add_argument(
        "--mapping", type=Path, help="mapping YAML: which signals are joints, pressures, commands"
    )
    parser.add_argument("--channel", help="interface to read, where the log has several")
    options = parser.parse_args(argv)
    return run(lambda: _decode(options))


def _decode(options: argparse.Namespace) -> None:
    to_table = options.out.suffix in TABLES
    if not to_table and options.mapping is None:
        raise ConfigurationError(
            f"{options.out}: a bag needs --mapping, which says what the signals mean: no common "
            f"ROS message holds signals by name; or name a table, {' or '.join(TABLES)}"
        )
    log = Log(options.log, options.channel)
    table = LogTable(load_dbc(options.dbc))
    if to_table:
        _read(log, table, None)
        _write(table.table(), options.out)
        print(describe(log, table))
        return
    _write_bag(log, table, load_layout(options.mapping, options.dbc), options.out)


def _write_bag(log: Log, table: LogTable, layout: Layout, path: Path) -> None:
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
    print(describe(log, table))
    print("\n".join(_describe_bag(path, bag)))


def _write(table: pl.DataFrame, path: Path) -> None:
    try:
        if path.suffix == ".csv":
            table.write_csv(path)
        else:
            table.write_parquet(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror or error}") from None


def _read(log: Log, table: LogTable, bag: LogBag | None) -> None:
    size = log.path.stat().st_size if log.path.is_file() else None
    with tqdm(total=size, unit="B", unit_scale=True, desc=log.path.name, delay=2) as bar:
        for frame in log.frames(bar.update):
            table.add(frame)
            if bag:
                bag.add(frame)
    if table.frames == 0:
        raise DataError(
            f"{log.path}: no frame in {log.lines} lines ({log.damaged} of them damaged, "
            f"{log.others} of other channels); name a log of candump -l and one of its channels"
        )


def _describe_bag(path: Path, bag: LogBag) -> list[str]:
    lines = [f"{path}: {topic}: {count} messages" for topic, count in bag.written.items()]
    lines += [f"{message}: {count} x {kind}" for (message, kind), count in bag.faults.items()]
    if bag.incomplete:
        lines.append(f"{bag.incomplete} cycles left out: not all of their frames are in the log")
    return lines
