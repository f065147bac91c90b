"""A bus log to a table of every signal, or to a bag of the crane's topics."""

import shutil
from dataclasses import dataclass
from datetime import tzinfo
from importlib import import_module
from pathlib import Path

from crane_bags.clocks import MISORDERED
from crane_bags.writer import BagWriter
from crane_driver.can.binding import load_layout
from crane_driver.can.bus_log import BusLog, Clock
from crane_driver.can.dbc import load_dbc
from crane_driver.can.layout import Layout
from crane_driver.can.log_bag import LogBag
from crane_driver.can.log_formats import open_log
from crane_driver.can.log_report import beside, describe
from crane_driver.can.log_table import LogTable
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.progress_bar import progress_bar

TABLES = (".csv", ".parquet")


@dataclass(frozen=True)
class Request:
    """What to decode: `mapping` is needed for a bag, `channel` if the log has several."""

    log: Path
    dbc: Path
    out: Path  # a table, or the folder of a bag
    machine: Machine
    mapping: Path | None = None
    channel: str | None = None
    zone: tzinfo | None = None  # of a log in local time
    keep_codes: bool = False  # in a table; for a bag the mapping says so


def decode(request: Request) -> str:
    """Decode a log, and say what was in it.

    `DataError` and `ConfigurationError` name file, limit and remedy; `ModuleNotFoundError` if what
    writes tables is not installed.
    """
    out = request.out
    if out.suffix in TABLES:
        import_module("polars")  # before the log is read, which may take long
    elif request.mapping is None:
        raise ConfigurationError(
            f"{out}: a bag needs --mapping, which says what the signals mean: no common ROS "
            f"message holds signals by name; or name a table, {' or '.join(TABLES)}"
        )
    log = open_log(request.log, request.channel, request.zone)
    if request.zone and log.clock is not Clock.LOCAL:
        raise ConfigurationError(
            f"{request.log}: --zone is for logs in local time, this one holds UTC; leave it out"
        )
    if out.suffix in TABLES:
        table = LogTable(load_dbc(request.dbc), request.keep_codes)
        _read(log, table, None)
        table.write(out, log.stamps)
        return describe(log, table)
    assert request.mapping is not None  # checked above
    layout = load_layout(request.machine, request.mapping, request.dbc, listen_only=True)
    table = LogTable(load_dbc(request.dbc), keep_codes=not layout.codes)
    bag = _write_bag(log, table, layout, out)
    lines = [*_describe_bag(out, bag), *_not_taken(table, bag, layout)]
    return "\n".join([describe(log, table), *lines])


def _write_bag(log: BusLog, table: LogTable, layout: Layout, path: Path) -> LogBag:
    writer = BagWriter(path)  # refuses a folder that exists
    try:
        with writer:
            bag = LogBag(writer, layout)
            _read(log, table, bag)
            bag.finish()
            if log.behind > MISORDERED * table.frames:
                raise DataError(
                    f"{log.path}: {log.back_in_words}: samples of two moments would be mixed; "
                    "record with one clock, or decode to a table"
                )
            if not bag.written:
                reasons = "; ".join(_not_taken(table, bag, layout))
                raise DataError(
                    f"{log.path}: its frames make no message: {reasons or 'none is whole'}; is it "
                    "of this machine?"
                )
    except DataError:
        shutil.rmtree(path)
        raise
    return bag


def _read(log: BusLog, table: LogTable, bag: LogBag | None) -> None:
    with progress_bar(log.path.name, log.size) as bar:
        for frame in log.frames(bar.update):
            table.add(frame)
            if bag:
                bag.add(frame)
    if table.frames == 0:
        of_channel = f" of channel {log.channel}" if log.channel else ""
        remedy = (
            f"one of its channels: {', '.join(sorted(log.channels))}"
            if log.others
            else "another log"
        )
        raise DataError(
            f"{log.path}: no data frame{of_channel} in {log.lines} lines: "
            f"{', '.join(beside(log)) or 'nothing else'}; name {remedy}"
        )


def _describe_bag(path: Path, bag: LogBag) -> list[str]:
    lines = [f"{path}: {topic}: {count} messages" for topic, count in bag.written.items()]
    lines += [f"{message}: {count} x {kind}" for (message, kind), count in bag.faults.items()]
    if bag.incomplete:
        lines.append(f"{bag.incomplete} cycles left out: not all of their frames are in the log")
    return lines


def _not_taken(table: LogTable, bag: LogBag, layout: Layout) -> list[str]:
    """Messages of the mapping of which frames are missing in the bag."""
    lines = []
    for one in (*layout.readings, *layout.commands):
        ids = [id for id, sender in table.senders.items() if sender.message.name == one.name]
        unused = [id for id in ids if (int(id, 16), len(id) == 8) in bag.unused]
        if unused:
            lines.append(
                f"{one.name} comes from {', '.join(ids)}, and the bag takes it from {one.id} only: "
                "write the id that is meant into the DBC"
            )
        elif not ids:
            lines.append(f"no frame of {one.name} ({one.id}) is in the log")
    return lines
