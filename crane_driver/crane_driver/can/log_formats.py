"""Bus logs of every known format, which their content tells and not their names."""

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
from can.util import dlc2len

from crane_bags.clocks import NANOSECONDS
from crane_bags.fields import read_messages
from crane_bags.storage import MCAP_MAGIC
from crane_bags.types import CAN_FRAMES
from crane_driver.can.bus_log import (
    EARLIEST,
    BusLog,
    Clock,
    Entry,
    content,
    encoding_of,
    nanoseconds,
    text_encoding,
)
from crane_driver.can.frame import Frame
from crane_model.errors import DataError

CANDUMP_LINE = re.compile(
    r"\((?P<seconds>\d+)\.(?P<fraction>\d{1,9})\)\s+(?P<channel>\S+)\s+"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(?:#[0-9A-Fa-f])?(?P<remote>R)?(?P<data>(?:[0-9A-Fa-f]{2}){0,64})"
    r"(?(remote)[0-9A-Fa-f]{0,2}|)(?:_[9A-Fa-f])?(?:\s+[RT])?"
)
CANDUMP_SCREEN_LINE = re.compile(  # of candump -ta (since 1970) and -tA (local time)
    r"\((?:(?P<seconds>\d{9,})|(?P<date>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d))\.(?P<fraction>\d{1,9})\)"
    r"\s+(?P<channel>\S+)\s+(?:[RT]X\s+\S\s+\S\s+)?(?P<id>[0-9A-F]{3}|[0-9A-F]{8})"
    r"\s+[\[{](?P<length>\d{1,2})[\]}]"
    r"(?:\s+(?P<remote>remote request)|(?P<data>(?:\s+[0-9A-F]{2})*))"
    r"(?:\s+ERRORFRAME)?(?:\s+'.*')?"
)
CAN_ERR_FLAG = 0x20000000
LARGEST_IDENTIFIER = 0x1FFFFFFF

ASC_STAMP = r"(?P<sign>-?)(?P<seconds>\d+)[.,](?P<fraction>\d{1,9})"
ASC_IDENTIFIER = r"(?P<id>[0-9a-f]+)(?P<extended>x?)"
ASC_DIRECTION = r"(?P<direction>rx|tx|txrq)"
ASC_FRAME_PATTERNS = (
    rf"(?P<channel>\d+)\s+{ASC_IDENTIFIER}\s+{ASC_DIRECTION}\s+(?P<kind>[dr])"
    r"(?:\s+(?P<dlc>[0-9a-f]{1,2}))?(?P<data>(?:\s.*)?)",
    rf"CANFD\s+(?P<channel>\d+)\s+{ASC_DIRECTION}\s+{ASC_IDENTIFIER}\s+(?:[a-z_]\S*\s+)?[01]\s+[01]\s+"
    r"(?P<dlc>[0-9a-f]{1,2})\s+(?P<length>\d{1,2})(?P<data>(?:\s.*)?)",
    rf"CANFD\s+(?P<channel>\d+)\s+{ASC_IDENTIFIER}\s+{ASC_DIRECTION}\s+[01]\s+[01]\s+(?P<kind>[dr])\s+"
    r"(?P<dlc>[0-9a-f]{1,2})(?:\s+(?P<length>\d{1,2}))?(?P<data>(?:\s.*)?)",
)
ASC_ERROR_PATTERN = r"(?:CANFD\s+)?(?P<channel>\d+)\s+(?:(?:rx|tx)\s+)?errorframe\b.*"
ASC_EVENT_PATTERNS = {
    "status lines": r"CAN\s+\d+\s+status.*",
    "statistic lines": r"\d+\s+statistic.*",
    "lines of the J1939 transport protocol": r"\d+\s+J1939TP.*",
    "frames with a name in the place of the identifier": (
        r"(?:CANFD\s+)?\d+\s+(?:(?:rx|tx)\s+)?(?![0-9a-f]+x?\s)[a-z_]\S*\s+"
        r"(?:(?:rx|tx)\s+[dr]\b|[01]\s+[01]\s).*"
    ),
    "lines of other events": r"(?!CANFD\s+\d)[^\d\s].*|\d+\s+(?![0-9a-f]*x?\s)[a-z_].*",
}
ASC_LINE = re.compile(rf"{ASC_STAMP}(?:\s+(?P<rest>.*))?")
ASC_FRAMES = tuple(re.compile(pattern, re.IGNORECASE) for pattern in ASC_FRAME_PATTERNS)
ASC_ERROR_FRAME = re.compile(ASC_ERROR_PATTERN, re.IGNORECASE)
ASC_EVENTS = {
    name: re.compile(pattern, re.IGNORECASE) for name, pattern in ASC_EVENT_PATTERNS.items()
}
ASC_REQUESTS = "requests to transmit"

ASC_DATE = re.compile(r"date\s+(?P<date>.*)", re.IGNORECASE)
ASC_FORMAT = re.compile(
    r"(?=base|timestamps)(?:base\s+(?P<base>hex|dec)\b\s*)?"
    r"(?:timestamps\s+(?P<stamps>absolute|relative)\b)?",
    re.IGNORECASE,
)
ASC_BLOCK = re.compile(r"begin\s+triggerblock\b(?P<date>.*)", re.IGNORECASE)
ASC_REMARK = re.compile(
    r"//.*|(no\s+)?internal\s+events\s+logged.*|end\s+triggerblock.*", re.IGNORECASE
)
ASC_MOMENT = re.compile(
    r"(?P<month>[^\s\d]+)\s+(?P<day>\d{1,2})\.?\s+"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,:](?P<fraction>\d{1,6}))?"
    r"\s*(?P<half>[ap]m)?\s+(?P<year>\d{4})",
    re.IGNORECASE,
)
# English and German, without what is not ASCII: files come in any encoding
MONTHS = ("jan", "feb", "mar mr mrz", "apr", "may mai", "jun", "jul", "aug", "sep", "oct okt")
MONTH = {
    name: number
    for number, names in enumerate((*MONTHS, "nov", "dec dez"), start=1)
    for name in names.split()
}
LARGEST_STANDARD_IDENTIFIER = 0x7FF
CLASSIC_CAN_BYTES = 8

TRC_START = re.compile(  # a remark of TRC 1.0, whose stamps count from it
    r";\s*start time:\s*(?:(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})"
    r"|(?P<iso>\d{4}-\d\d-\d\d))\s+(?P<clock>\d{1,2}:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,6}))?.*",
    re.IGNORECASE,
)

SQLITE_MAGIC = b"SQLite format 3\x00"
BEGINNING_BYTES = 4096  # bytes that tell the format
SCREEN_LINE = re.compile(r"(\(.*\)\s+)?\S+\s+([RT]X\s.*)?[0-9A-F]{3,8}\s+[\[{]\d+[\]}].*")


ASC_BEGINNING = re.compile(
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
    Format("SQLite", can.SqliteReader, re.compile(SQLITE_MAGIC)),
    Format("TRC", can.TRCReader, re.compile(rb"\s*;(\$FILEVERSION|##|-)"), Clock.LOCAL),
    Format("CSV", can.CSVReader, re.compile(rb"timestamp,arbitration_id,")),
)
READABLE = f"candump, ASC, {', '.join(known.name for known in FORMATS)}, bags of CAN frames"


@dataclass
class CandumpLog(BusLog):
    """A log of `candump -l`, or what candump shows on the screen with `-ta` or `-tA`.

    Unlike python-can's reader it keeps the stamps exact, goes on after a damaged line, and does not
    take the error frames of SocketCAN for data.
    """

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        with content(self.path) as file:
            for line in io.TextIOWrapper(file, text_encoding(file), errors="replace"):
                on_bytes(len(line))
                if not (shown := line.strip()):
                    continue
                self.lines += 1
                match = CANDUMP_LINE.fullmatch(shown) or CANDUMP_SCREEN_LINE.fullmatch(shown)
                if match and (entry := _candump_entry(match.groupdict(), self.zone)):
                    yield entry
                else:
                    self.damaged += 1


def _candump_entry(match: dict[str, str | None], zone: tzinfo | None) -> Entry | None:
    """Entry of a line; None if it shows fewer bytes than it says."""
    identifier, channel = match["id"], match["channel"]
    assert identifier is not None and channel is not None  # every line has them
    number, extended = int(identifier, 16), len(identifier) == 8
    if date := match.get("date"):
        second = nanoseconds(datetime.fromisoformat(date), zone)
    else:
        second = int(match["seconds"] or 0) * NANOSECONDS
    stamp = second + int((match["fraction"] or "").ljust(9, "0"))
    data = bytes.fromhex(match["data"] or "")
    if not match["remote"] and int(match.get("length") or len(data)) != len(data):
        return None
    frame = Frame(number & LARGEST_IDENTIFIER, data, extended, stamp, stamp / 1e9)
    error = extended and bool(number & CAN_ERR_FLAG)
    return Entry(channel, frame, remote=match["remote"] is not None, error=error)


@dataclass
class AscLog(BusLog):
    """A log of Vector's CANoe, CANalyzer and loggers, or of tools that write the same text.

    Stamps count from the date in the header, or from that of a trigger block in which they begin
    anew; `timestamps relative` are differences to the line before. Unlike python-can's reader it
    adds up relative stamps, numbers channels as the file does, reads the same stamps on every
    computer, keeps them exact, and counts the lines that it cannot use.
    """

    clock: Clock = Clock.LOCAL

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        self.clock = Clock.LOCAL
        time = _AscTime(self)
        base = 16
        with content(self.path) as file:
            for line in io.TextIOWrapper(file, text_encoding(file), errors="replace"):
                on_bytes(len(line))
                if not (shown := line.strip()):
                    continue
                self.lines += 1
                if match := ASC_LINE.fullmatch(shown):
                    stamp = time.stamp(match)
                    if (entry := self._entry(match["rest"] or "", stamp, base)) is not None:
                        yield entry
                elif match := ASC_FORMAT.match(shown):
                    if match["base"]:
                        base = 10 if match["base"].lower() == "dec" else 16
                    if match["stamps"]:
                        time.relative = match["stamps"].lower() == "relative"
                elif match := ASC_DATE.fullmatch(shown):
                    time.start(match["date"])
                elif match := ASC_BLOCK.fullmatch(shown):
                    time.block(match["date"])
                elif not ASC_REMARK.fullmatch(shown):
                    self.damaged += 1
                    self.lost_steps += time.relative

    def _entry(self, text: str, stamp: int, base: int) -> Entry | None:
        """Frame of a line, behind its stamp; None, and counted, if it is not a whole frame."""
        for pattern in ASC_FRAMES:
            if match := pattern.fullmatch(text):
                if match["direction"].lower() == "txrq":
                    self.events[ASC_REQUESTS] += 1  # the frame itself follows
                    return None
                if entry := _asc_frame(match.groupdict(), stamp, base):
                    return entry
                self.damaged += 1
                return None
        if match := ASC_ERROR_FRAME.fullmatch(text):
            return Entry(match["channel"], Frame(0, b"", False, stamp, stamp / 1e9), error=True)
        kind = next((name for name, pattern in ASC_EVENTS.items() if pattern.fullmatch(text)), None)
        if kind is None:
            self.damaged += 1
        else:
            self.events[kind] += 1
        return None


class _AscTime:
    """From the stamps of the lines to time [ns]."""

    def __init__(self, log: AscLog):
        self._log = log
        self.relative = False
        self._origin = 0  # ns, what the next stamp adds to
        self._block: int | None = None  # ns, date of a block of which no stamp was read so far

    def start(self, date: str) -> None:
        self._origin = self._read(date) or 0

    def block(self, date: str) -> None:
        self._block = self._read(date)

    def stamp(self, match: re.Match[str]) -> int:
        since = int(match["seconds"]) * NANOSECONDS + int(match["fraction"].ljust(9, "0"))
        since = -since if match["sign"] else since
        if self._block is not None:
            # Either the stamps go on, or they begin anew with the block: what is nearer to its date
            if abs(self._origin + since - self._block) >= abs(since):
                self._origin = self._block
            self._block = None
        stamp = self._origin + since
        if self.relative:
            self._origin = stamp
        return stamp

    def _read(self, text: str) -> int | None:
        """A date of local time; None, and counted, if it cannot be read."""
        match = ASC_MOMENT.search(text)
        month = match and MONTH.get(re.sub("[^a-z]", "", match["month"].lower())[:3])
        try:
            if not match or not month:
                raise ValueError
            hour, half = int(match["hour"]), (match["half"] or "").lower()
            if half and hour <= 12:
                hour = hour % 12 + 12 * (half == "pm")
            date = datetime(
                *(int(match["year"]), month, int(match["day"])),
                *(hour, int(match["minute"]), int(match["second"])),
                int((match["fraction"] or "").ljust(6, "0")),
            )
        except ValueError:
            if text.strip():
                self._log.events["dates that cannot be read"] += 1
            return None
        return nanoseconds(date, self._log.zone)


def _asc_frame(found: dict[str, str | None], stamp: int, base: int) -> Entry | None:
    channel, digits = found["channel"], found["id"]
    assert channel is not None and digits is not None
    try:
        identifier, dlc = int(digits, base), int(found["dlc"] or "0", base)
        remote = (found.get("kind") or "d").lower() == "r"
        if found.get("length") is not None:
            length = int(found["length"] or "0")
            remote = remote or (length == 0 < dlc)
        else:
            length = min(dlc2len(dlc), CLASSIC_CAN_BYTES)
        shown = [] if remote else (found["data"] or "").split()[:length]
        data = bytes(int(byte, base) for byte in shown)
    except ValueError:  # no number of this base, or none of a byte
        return None
    if identifier > LARGEST_IDENTIFIER or (len(data) < length and not remote):
        return None
    extended = bool(found["extended"]) or identifier > LARGEST_STANDARD_IDENTIFIER
    return Entry(channel, Frame(identifier, data, extended, stamp, stamp / 1e9), remote)


def open_log(path: Path, channel: str | None = None, zone: tzinfo | None = None) -> BusLog:
    """Open a log of any format, which its content tells.

    `channel` is the one to read, `zone` the time zone of a log in local time (see `BusLog`).
    `DataError` if the log is absent, empty or of no known format.
    """
    if path.is_dir():
        return BagOfFrames(path, channel)
    try:
        with content(path) as file:
            beginning = file.read(BEGINNING_BYTES)
    except (OSError, EOFError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise DataError(f"{path}: cannot be read: {reason}") from None
    if beginning.startswith(MCAP_MAGIC) or (beginning.startswith(SQLITE_MAGIC) and _is_bag(path)):
        return BagOfFrames(path, channel)
    if encoding := encoding_of(beginning):
        beginning = beginning.decode(encoding, "replace").encode()
    for known in FORMATS:
        if known.beginning.match(beginning):
            return PythonCanLog(path, channel, zone, known.clock, format=known)
    if ASC_BEGINNING.match(beginning):
        return AscLog(path, channel, zone)
    lines = [line.strip() for line in beginning.decode("utf-8", "replace").splitlines()]
    lines = [line for line in lines if line]
    if any(CANDUMP_LINE.fullmatch(line) for line in lines):
        return CandumpLog(path, channel, zone)
    if shown := [match for line in lines if (match := CANDUMP_SCREEN_LINE.fullmatch(line))]:
        return CandumpLog(path, channel, zone, Clock.LOCAL if shown[0]["date"] else Clock.EPOCH)
    if not lines:
        raise DataError(f"{path}: the log is empty")
    if any(SCREEN_LINE.fullmatch(line) for line in lines):
        raise DataError(
            f"{path}: what candump shows on the screen, with relative stamps; record "
            "with candump -l, or show them with -ta"
        )
    raise DataError(
        f"{path}: not a log of a known format ({READABLE}); it begins with {lines[0][:60]!r}"
    )


def _is_bag(path: Path) -> bool:
    """Return whether a file of SQLite is of a bag: python-can writes such files, too."""
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
                message.id & LARGEST_IDENTIFIER,
                bytes(message.data[:length]),
                message.is_extended,
                stamp,
                stamp / 1e9,
            )
            remote = getattr(message, "is_rtr", False)
            yield Entry(topic, frame, remote, message.is_error)


class _Rows(io.TextIOWrapper):
    """Text that counts its rows, without remarks: python-can skips those it cannot read.

    `start`: the date of a remark, if there is one [s since 1970, as if in UTC]; python-can reads
    none of them.
    """

    count = 0
    start = 0.0

    def __next__(self) -> str:  # type: ignore[override]  # as in the class above
        line = super().__next__()
        self.count += line.strip()[:1] not in ("", ";")
        if match := TRC_START.fullmatch(line.strip()):
            self.start = _trc_start(match)
        return line


def _trc_start(match: re.Match[str]) -> float:
    """Date of a remark [s since 1970, as if in UTC]; 0 if it is not a date."""
    day = match["iso"] or f"{match['year']}-{match['month']:0>2}-{match['day']:0>2}"
    try:
        date = datetime.fromisoformat(f"{day} {match['clock']:0>8}+00:00")
    except ValueError:
        return 0.0
    return date.timestamp() + float(f"0.{match['fraction'] or 0}")


@dataclass
class PythonCanLog(BusLog):
    """A log that python-can reads."""

    format: Format = field(kw_only=True)

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        self.clock = self.format.clock
        position = 0
        with content(self.path) as file:
            try:
                rows = _Rows(file, encoding=text_encoding(file), errors="replace")
                for message in self._reader(file, rows):
                    self.lines += 1
                    position, before = file.tell(), position
                    on_bytes(position - before)
                    if self.lines == 1:
                        start = 0.0 if message.timestamp * 1e9 > EARLIEST else rows.start
                        shift = self._shift(message.timestamp + start) + round(start * 1e9)
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
            message.arbitration_id, bytes(message.data), message.is_extended_id, stamp, stamp / 1e9
        )
        channel = message.channel
        number = channel + self.format.channel if isinstance(channel, int) else channel
        return Entry(str(number), frame, message.is_remote_frame, message.is_error_frame)
