"""Bus logs of any format that is known here, told by what is in them and not by their names."""

import io
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import can
from can.io.generic import BinaryIOMessageReader, MessageReader, TextIOMessageReader

from crane_bags.clocks import NANOSECONDS
from crane_bags.fields import read_messages
from crane_bags.storage import MCAP_MAGIC
from crane_bags.types import CAN_FRAMES
from crane_driver.can.asc import AscLog
from crane_driver.can.bus_log import (
    IDENTIFIER,
    LINE,
    BusLog,
    CandumpLog,
    Clock,
    Entry,
    content,
    nanoseconds,
)
from crane_driver.can.frame import Frame
from crane_model.errors import DataError

SQLITE = b"SQLite format 3\x00"
BEGINNING = 4096  # bytes that tell the format
SCREEN = re.compile(r"(\(.*\)\s+)?\S+\s+[0-9A-F]{3,8}\s+\[\d+\](\s+[0-9A-F]{2})*(\s+'.*')?")


ASC = re.compile(
    rb"\s*(date\s|base\s|//|begin\s+trigger|-?\d+[.,]\d+\s+(CANFD\s+)?\d+\s.*\s[RT]xQ?\s)", re.I
)


class Format(NamedTuple):
    """A format that python-can reads, and how it begins.

    clock: origin of the stamps. channel: difference between the number of a channel in the file and
    that of python-can, which subtracts one in Vector's formats.
    """

    name: str
    reader: type[MessageReader]
    beginning: re.Pattern[bytes]
    clock: Clock = Clock.EPOCH
    channel: int = 0


FORMATS = (
    Format("BLF", can.BLFReader, re.compile(rb"LOGG"), Clock.LOCAL, 1),
    Format("MF4", can.MF4Reader, re.compile(rb"MDF     |UnFinMF ")),
    Format("SQLite", can.SqliteReader, re.compile(SQLITE)),
    Format("TRC", can.TRCReader, re.compile(rb"\s*;(\$FILEVERSION|##|-)"), Clock.LOCAL),
    Format("CSV", can.CSVReader, re.compile(rb"timestamp,arbitration_id,")),
)
READABLE = f"candump -l, ASC, {', '.join(one.name for one in FORMATS)}, bags of CAN frames"


def open_log(path: Path, channel: str | None = None, zone: tzinfo | None = None) -> BusLog:
    """Open a log of any format, which its content tells.

    `channel` is the one to read, `zone` the time zone of a log in local time (see `BusLog`).
    `DataError` if the log is absent, empty or of no known format.
    """
    if path.is_dir():
        return BagOfFrames(path, channel)
    try:
        with content(path) as file:
            beginning = file.read(BEGINNING)
    except (OSError, EOFError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise DataError(f"{path}: cannot be read: {reason}") from None
    if beginning.startswith(MCAP_MAGIC) or (beginning.startswith(SQLITE) and _is_bag(path)):
        return BagOfFrames(path, channel)
    for known in FORMATS:
        if known.beginning.match(beginning.removeprefix(b"\xef\xbb\xbf")):
            return PythonCanLog(path, channel, zone, known.clock, format=known)
    if ASC.match(beginning.removeprefix(b"\xef\xbb\xbf")):
        return AscLog(path, channel, zone)
    lines = [line.strip() for line in beginning.decode("ascii", "replace").splitlines()]
    lines = [line for line in lines if line]
    if any(LINE.fullmatch(line) for line in lines):
        return CandumpLog(path, channel, zone)
    if not lines:
        raise DataError(f"{path}: the log is empty")
    if any(SCREEN.fullmatch(line) for line in lines):
        raise DataError(
            f"{path}: what candump shows on the screen, with stamps that do not tell when; record "
            "with candump -l"
        )
    raise DataError(
        f"{path}: not a log of a known format ({READABLE}); it begins with {lines[0][:60]!r}"
    )


def _is_bag(path: Path) -> bool:
    """Whether a file of SQLite is of a bag: python-can writes such files, too."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        try:
            tables = database.execute("SELECT name FROM sqlite_master").fetchall()
        except sqlite3.DatabaseError:  # whoever reads it says what is wrong
            return False
    return ("topics",) in tables


@dataclass
class BagOfFrames(BusLog):
    """A bag of CAN frames, as ros2_socketcan records it: a topic is a channel."""

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Message by message."""
        told = 0

        def progress(_: str, share: float) -> None:
            nonlocal told
            done = round(share * self.size)
            on_bytes(done - told)
            told = done

        for topic, log_time, message in read_messages(self.path, CAN_FRAMES, progress):
            self.lines += 1
            header = message.header.stamp
            stamp = header.sec * NANOSECONDS + header.nanosec or log_time
            length = message.dlc if hasattr(message, "dlc") else message.len
            frame = Frame(
                message.id & IDENTIFIER,
                bytes(message.data[:length]),
                message.is_extended,
                stamp,
                stamp / 1e9,
            )
            remote = getattr(message, "is_rtr", False)
            yield Entry(topic, frame, remote, message.is_error)


class _Rows(io.TextIOWrapper):
    """Text that counts its rows, without comments: python-can skips those it cannot read."""

    count = 0

    def __next__(self) -> str:  # type: ignore[override]  # as in the class above
        line = super().__next__()
        self.count += line.strip()[:1] not in ("", ";")
        return line


@dataclass
class PythonCanLog(BusLog):
    """A log that python-can reads."""

    format: Format = field(kw_only=True)

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Message by message; where the log is damaged it ends, and `broken` says why."""
        self.clock = self.format.clock
        position, shift = 0, None
        with content(self.path) as file:
            try:
                rows = _Rows(file, encoding="utf-8-sig", errors="replace")
                for message in self._reader(file, rows):
                    self.lines += 1
                    position, before = file.tell(), position
                    on_bytes(position - before)
                    shift = self._shift(message.timestamp) if shift is None else shift
                    yield self._entry(message, shift)
                if self.format.reader is can.TRCReader and rows.count > self.lines:
                    self.events["lines without a frame that can be read"] = rows.count - self.lines
            except NotImplementedError as error:  # of MF4, whose package is not there
                raise DataError(
                    f"{self.path}: {self.format.name} needs asammdf, which is not "
                    "installed; install it in this shell: pip install asammdf"
                ) from error
            except Exception as error:  # parsers stumble over anything in a damaged file
                reason = str(error) or type(error).__name__
                if not self.lines:
                    raise DataError(
                        f"{self.path}: no frame could be read, as {self.format.name}: {reason}"
                    ) from error
                self.broken = reason

    def _reader(self, file: BinaryIO, rows: io.TextIOWrapper) -> MessageReader:
        reader: Any = self.format.reader
        if issubclass(reader, TextIOMessageReader):
            return reader(rows)
        if issubclass(reader, BinaryIOMessageReader):
            return reader(file)
        return reader(self.path)

    def _shift(self, timestamp: float) -> int:
        """Difference of UTC to local time, which python-can takes for UTC [ns], at a stamp [s]."""
        if self.zone is None or self.clock is not Clock.LOCAL:
            return 0
        local = datetime.fromtimestamp(timestamp, UTC).replace(tzinfo=None)
        return nanoseconds(local, self.zone) - nanoseconds(local, UTC)

    def _entry(self, message: can.Message, shift: int) -> Entry:
        stamp = round(message.timestamp * 1e9) + shift
        frame = Frame(
            message.arbitration_id,
            bytes(message.data),
            message.is_extended_id,
            stamp,
            stamp / 1e9,
        )
        channel = message.channel
        number = channel + self.format.channel if isinstance(channel, int) else channel
        return Entry(str(number), frame, message.is_remote_frame, message.is_error_frame)
