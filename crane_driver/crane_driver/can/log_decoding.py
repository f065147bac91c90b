"""A bus log to a table of every signal, or to a bag of the crane's topics."""

import math
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import tzinfo
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_bags.clocks import MAX_JUMP_NS, MAX_MISORDERED_SHARE
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND
from crane_bags.writer import BagWriter
from crane_driver import constants
from crane_driver.can.assembly import Assembly, Complete
from crane_driver.can.binding import load_layout
from crane_driver.can.bus_log import BusLog, Clock
from crane_driver.can.codec import DriverCodec, Readings
from crane_driver.can.dbc import by_group_alone, load_dbc
from crane_driver.can.frame import Frame
from crane_driver.can.health import HeardCommands, Monitor
from crane_driver.can.layout import Layout
from crane_driver.can.log_formats import open_log
from crane_driver.can.log_table import LogTable, Sender
from crane_driver.can.mapping import LINES
from crane_driver.faults import UNUSABLE, Fault
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.progress_bar import progress_bar

TABLE_SUFFIXES = (".csv", ".parquet")


class Cycle(NamedTuple):
    """Timing of the frames of one identifier over the log."""

    id: str
    message: str
    frames: int
    declared: float | None  # s, the DBC's cycle time
    median: float  # s, NaN for a single frame
    longest_gap: float  # s without a frame, the ends of the log included
    longest_gap_at: float  # s after the first frame of the log, where it begins
    gaps: int


def cycles(table: LogTable) -> list[Cycle]:
    """Timing of every decoded identifier, by message."""
    found = [_cycle(sender, table.first, table.last) for sender in table.senders.values()]
    return sorted(found, key=lambda cycle: (cycle.message, cycle.id))


def _cycle(sender: Sender, first: int, last: int) -> Cycle:
    stamps = np.array(sender.stamps, dtype=np.int64)
    ends = np.concatenate(([first], stamps, [last]))
    silences = np.diff(ends) / 1e9
    median = float(np.median(silences[1:-1])) if len(stamps) > 1 else np.nan
    longest = int(np.argmax(silences))
    declared = sender.message.cycle_time
    return Cycle(
        sender.id,
        sender.message.name,
        len(stamps),
        declared / 1000 if declared else None,
        median,
        float(silences[longest]),
        float(ends[longest] - first) / 1e9,
        int(np.count_nonzero(silences > constants.GAP_CYCLES * median)),
    )


def describe(log: BusLog, table: LogTable) -> str:
    """The report on a log that was read to its end."""
    unknown, failed = table.unknown.total(), table.failed.total()
    lines = [
        f"{table.frames} frames read over {table.duration / 1e9:.3f} s: {table.decoded} decoded, "
        f"{unknown} of {len(table.unknown)} unknown ids, {failed} not decodable",
        *(f"also {text}" for text in beside(log)),
        *_about_stamps(log),
        "",
        f"{'message':24} {'id':>8} {'frames':>7} {'cycle [ms]':>11} {'in DBC':>7} "
        f"{'gaps':>5} {'longest gap':>13}",
    ]
    for cycle in cycles(table):
        declared = f"{cycle.declared * 1e3:g}" if cycle.declared else "-"
        lines.append(
            f"{cycle.message:24} {cycle.id:>8} {cycle.frames:7} {cycle.median * 1e3:11.2f} "
            f"{declared:>7} {cycle.gaps:5} {cycle.longest_gap * 1e3:7.1f} ms at "
            f"{cycle.longest_gap_at:.3f} s"
        )
    lines += ["", f"a gap is longer than {constants.GAP_CYCLES} median cycles"]
    lines += [f"not decodable: {text}" for text in _failed(table)]
    if table.codes:
        counts = [f"{name}: {count} x {code}" for (name, code), count in table.codes.items()]
        lines.append(
            "not measurements, but codes (of J1939 where the DBC states no range, or of its value "
            "tables): "
            f"{', '.join(counts)}"
        )
    if guessed := [
        f"{sender.id} as {sender.message.name}"
        for sender in table.senders.values()
        if by_group_alone(sender.message, sender.id)
    ]:
        lines.append(
            f"by group number (PGN) alone, as in J1939, which the DBC does not say: "
            f"{', '.join(guessed)}"
        )
    if unknown:
        lines.append(f"unknown ids: {_unknown(table)}")
    return "\n".join(lines)


def _failed(table: LogTable, only: str = "") -> list[str]:
    """The frames that could not be decoded, of all messages or of one."""
    return [
        f"{count} frames of {message} ({identifier}): {reason}"
        for (identifier, message, reason), count in table.failed.most_common()
        if only in ("", message)
    ]


def _unknown(table: LogTable) -> str:
    named = [
        f"{name}: {count}"
        for name, count in table.unknown.most_common(constants.LISTED_IDENTIFIERS)
    ]
    more = len(table.unknown) - len(named)
    return ", ".join(named) + (f", and {more} more" if more else "")


def beside(log: BusLog) -> list[str]:
    """Counts of everything in a log that was not read as a data frame."""
    counts = {
        "damaged lines, skipped": log.damaged,
        "error frames": log.errors,
        "remote frames": log.remote,
        "frames of other channels": log.others,
        **log.events,
    }
    return [f"{count} {what}" for what, count in counts.items() if count]


def _about_stamps(log: BusLog) -> list[str]:
    lines = []
    if log.clock is Clock.START:
        lines.append(
            "the log states no date that can be read: its stamps count seconds from its beginning"
        )
    elif log.stamps is Clock.LOCAL:
        lines.append(
            "the log holds local time and does not state its zone: its stamps are kept as they "
            "are; for UTC name the zone, for example --zone Europe/Berlin"
        )
    elif log.clock is Clock.LOCAL:
        lines.append(f"the log holds local time, of the zone {log.zone}")
    if log.lost_steps:
        lines.append(
            f"stamps are relative, and {log.lost_steps} damaged lines hold none: all behind such a "
            "line is too early by what it held"
        )
    if log.set_back:
        lines.append(log.back_in_words)
    if log.broken:
        lines.append(f"the log is damaged behind them, and was read no further: {log.broken}")
    return lines


class LogBag:
    """Writes /joint_states, /cylinder_pressures and /valve_command from frames, those that the
    mapping has.

    Velocity and effort are NaN: they are no measurements, and who reads the bag computes them.
    """

    def __init__(self, bag: BagWriter, layout: Layout):
        self._driver, self._heard = DriverCodec(layout), HeardCommands(layout)
        self._monitor: Monitor | None
        self._newest: int  # ns
        self._layout = layout
        self._begin()
        self._cylinders = list(
            dict.fromkeys(name.split(".")[0] for name in layout.pressures if name not in LINES)
        )
        self._joint_states = bag.add_arrays(JOINT_STATES, layout.positions)
        self._nothing = np.full(len(layout.positions), np.nan)
        self._cylinder_pressures = (
            bag.add_arrays(CYLINDER_PRESSURES, self._cylinders) if self._cylinders else None
        )
        self._valve_command = (
            bag.add_arrays(VALVE_COMMAND, layout.valves) if layout.valves else None
        )
        self._left_out = 0  # cycles, before time went back
        self.written: Counter[str] = Counter()  # messages by topic
        self.faults: Counter[tuple[str, str]] = Counter()  # by message and kind

    @property
    def incomplete(self) -> int:
        """Cycles of positions or pressures left out because one of their frames is not there."""
        return self._left_out + self._positions.incomplete + self._pressures.incomplete

    @property
    def unused(self) -> Mapping[tuple[int, bool], int]:
        """Frames that the mapping does not use, by identifier (and whether it is extended)."""
        unknown = self._heard.unknown
        return {key: count for key, count in self._driver.unknown.items() if key in unknown}

    def add(self, frame: Frame) -> None:
        """Write what this frame completes; if time goes back, cycles begin anew.

        `DataError` if two devices send one message.
        """
        if frame.stamp < self._newest - MAX_JUMP_NS:
            self.finish()
            self._left_out = self.incomplete
            self._begin()
        self._newest = max(self._newest, frame.stamp)
        command, faults = self._heard.observe(frame)
        self._count(faults)
        if command and self._valve_command:
            values = list(command.commands.values())
            self._valve_command.write(command.stamp, command.stamp, values)
            self.written[VALVE_COMMAND.name] += 1
        if readings := self._driver.decode(frame):
            self._monitor = self._monitor or Monitor(
                self._layout.readings, self._layout.timing, frame.steady
            )
            faults = [*self._monitor.check(frame.steady), *self._monitor.observe(readings)]
            self._count(faults)
            if not any(fault.kind in UNUSABLE for fault in faults):
                self._readings(readings)
        if conflicts := self._driver.conflicts or self._heard.conflicts:
            message, (first, second) = next(iter(conflicts.items()))
            raise DataError(
                f"message {message}: {first} and {second} both send it, and the DBC names neither; "
                "write the id of the device that is meant into the DBC, or each as a message"
            )

    def _begin(self) -> None:
        self._newest = 0
        self._monitor = None
        self._positions = Assembly(self._layout, "positions")
        self._pressures = Assembly(self._layout, "pressures")

    def finish(self) -> None:
        self._write(self._positions.finish(), self._pressures.finish())

    def _readings(self, readings: Readings) -> None:
        self._write(self._positions.add(readings), self._pressures.add(readings))

    def _write(self, positions: Iterable[Complete], pressures: Iterable[Complete]) -> None:
        for complete in positions:
            position = list(complete.values.values())
            self._joint_states.write(
                complete.stamp, complete.stamp, position, self._nothing, self._nothing
            )
            self.written[JOINT_STATES.name] += 1
        if self._cylinder_pressures is None:
            return
        for complete in pressures:
            self._cylinder_pressures.write(
                complete.stamp, complete.stamp, *self._pressure_fields(complete)
            )
            self.written[CYLINDER_PRESSURES.name] += 1

    def _pressure_fields(self, complete: Complete) -> list[list[float] | float]:
        value = complete.values
        return [
            [value.get(f"{joint}.a", math.nan) for joint in self._cylinders],
            [value.get(f"{joint}.b", math.nan) for joint in self._cylinders],
            value.get("supply", math.nan),
            value.get("tank", math.nan),
        ]

    def _count(self, faults: Iterable[Fault]) -> None:
        for fault in faults:
            self.faults[fault.source, str(fault.kind)] += 1


@dataclass(frozen=True)
class DecodeRequest:
    """A log to decode: a bag needs `mapping`, a log of several channels needs `channel`."""

    log: Path
    dbc: Path
    out: Path  # a table, or the folder of a bag
    machine: Machine
    mapping: Path | None = None
    channel: str | None = None
    zone: tzinfo | None = None  # of a log in local time
    keep_codes: bool = False  # in a table; for a bag the mapping says so


def decode(request: DecodeRequest) -> str:
    """Decode a log, and say what was in it.

    `DataError` and `ConfigurationError` name file, limit and remedy; `ModuleNotFoundError` if what
    writes tables is not installed.
    """
    out = request.out
    if out.suffix in TABLE_SUFFIXES:
        import_module("polars")  # before the log is read, which may take long
    elif request.mapping is None:
        raise ConfigurationError(
            f"{out}: a bag needs --mapping, which says what the signals mean: no common ROS "
            f"message holds signals by name; or name a table, {' or '.join(TABLE_SUFFIXES)}"
        )
    log = open_log(request.log, request.channel, request.zone)
    if request.zone and log.clock is not Clock.LOCAL:
        raise ConfigurationError(
            f"{request.log}: --zone is for logs in local time, this one holds UTC; leave it out"
        )
    if out.suffix in TABLE_SUFFIXES:
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
            if log.behind > MAX_MISORDERED_SHARE * table.frames:
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
    if table.decoded == 0:
        reasons = [*_failed(table), *(f"unknown id {_unknown(table)}",) * bool(table.unknown)]
        raise DataError(
            f"{log.path}: none of {table.frames} frames can be decoded by the DBC: "
            f"{'; '.join(reasons)}; name the DBC of this bus and channel"
        )


def _describe_bag(path: Path, bag: LogBag) -> list[str]:
    lines = [f"{path}: {topic}: {count} messages" for topic, count in bag.written.items()]
    lines += [f"{message}: {count} x {kind}" for (message, kind), count in bag.faults.items()]
    if bag.incomplete:
        lines.append(f"{bag.incomplete} cycles left out: not all of their frames are in the log")
    return lines


def _not_taken(table: LogTable, bag: LogBag, layout: Layout) -> list[str]:
    lines = []
    for message in (*layout.readings, *layout.commands):
        ids = [id for id, sender in table.senders.items() if sender.message.name == message.name]
        unused = [id for id in ids if (int(id, 16), len(id) == 8) in bag.unused]
        if unused:
            lines.append(
                f"{message.name} comes from {', '.join(ids)}, and the bag takes it from "
                f"{message.id} only: write the id that is meant into the DBC"
            )
        elif not ids:
            lines.append(
                "; ".join(_failed(table, message.name))
                or f"no frame of {message.name} ({message.id}) is in the log"
            )
    return lines
