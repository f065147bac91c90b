"""Bus logs of any format that is known here, told by what is in them and not by their names."""

import gzip
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import can
from can.io.generic import BinaryIOMessageReader, MessageReader, TextIOMessageReader

from crane_driver.can.bus_log import BusLog, Entry
from crane_driver.can.candump import LINE, CandumpLog
from crane_driver.can.frame import Frame
from crane_model.errors import DataError

BEGINNING = 4096  # bytes that tell the format
GZIP = b"\x1f\x8b"
SCREEN = re.compile(r"(\(.*\)\s+)?\S+\s+[0-9A-F]{3,8}\s+\[\d+\](\s+[0-9A-F]{2})*(\s+'.*')?")


class Format(NamedTuple):
    """A format that python-can reads, and how it begins."""

    name: str
    reader: type[MessageReader]
    beginning: re.Pattern[bytes]


FORMATS = (
    Format("BLF", can.BLFReader, re.compile(rb"LOGG")),
    Format("MF4", can.MF4Reader, re.compile(rb"MDF     |UnFinMF ")),
    Format("SQLite", can.SqliteReader, re.compile(rb"SQLite format 3\x00")),
    Format("TRC", can.TRCReader, re.compile(rb"\s*;(\$FILEVERSION|##|-)")),
    Format("CSV", can.CSVReader, re.compile(rb"timestamp,arbitration_id,")),
    Format("ASC", can.ASCReader, re.compile(rb"\s*(date\s|base\s|//|begin trigger)", re.I)),
)
READABLE = f"candump -l, {', '.join(one.name for one in FORMATS)}"


def open_log(path: Path, channel: str | None = None) -> BusLog:
    """The log, by its content; `DataError` if it is absent, empty or of no known format."""
    try:
        with _content(path) as file:
            beginning = file.read(BEGINNING)
    except (OSError, EOFError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise DataError(f"{path}: cannot be read: {reason}") from None
    for known in FORMATS:
        if known.beginning.match(beginning.removeprefix(b"\xef\xbb\xbf")):
            return PythonCanLog(path, channel, format=known)
    lines = [line.strip() for line in beginning.decode("ascii", "replace").splitlines()]
    lines = [line for line in lines if line]
    if any(LINE.fullmatch(line) for line in lines):
        return CandumpLog(path, channel)
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


@dataclass
class PythonCanLog(BusLog):
    """A log that python-can reads."""

    format: Format = field(kw_only=True)

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Message by message; where the log is damaged it ends, and `broken` says why."""
        position = 0
        with _content(self.path) as file:
            try:
                for message in self._reader(file):
                    self.lines += 1
                    position, before = file.tell(), position
                    on_bytes(position - before)
                    yield _entry(message)
            except Exception as error:  # parsers stumble over anything in a damaged file
                reason = str(error) or type(error).__name__
                if not self.lines:
                    raise DataError(
                        f"{self.path}: no frame could be read, as {self.format.name}: {reason}"
                    ) from error
                self.broken = reason

    def _reader(self, file: BinaryIO) -> MessageReader:
        reader: Any = self.format.reader
        if issubclass(reader, TextIOMessageReader):
            text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
            options = {"relative_timestamp": False} if reader is can.ASCReader else {}
            return reader(text, **options)
        if issubclass(reader, BinaryIOMessageReader):
            return reader(file)
        return reader(self.path)


def _content(path: Path) -> BinaryIO:
    """The file, decompressed where it is compressed."""
    file = path.open("rb")
    compressed = file.read(len(GZIP)) == GZIP
    file.seek(0)
    return cast(BinaryIO, gzip.GzipFile(fileobj=file)) if compressed else file


def _entry(message: can.Message) -> Entry:
    stamp = round(message.timestamp * 1e9)
    frame = Frame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        stamp,
        message.timestamp,
    )
    channel = str(message.channel)
    return Entry(channel, frame, message.is_remote_frame, message.is_error_frame)
