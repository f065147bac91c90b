"""Common part of all bus logs: their data frames, and counts of everything else."""

import codecs
import gzip
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, tzinfo
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

from crane_bags.clocks import MAX_JUMP_NS, NANOSECONDS
from crane_driver.can.frame import Frame
from crane_model.errors import DataError

GZIP = b"\x1f\x8b"
BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
EARLIEST = 631_152_000_000_000_000  # ns, the year 1990: earlier stamps count from something else


class Clock(StrEnum):
    """Origin of the stamps of a log."""

    EPOCH = "since 1970 in UTC"
    LOCAL = "local time"  # of a computer whose time zone the log does not state
    START = "since the beginning"  # of the log, of which no date is stated


class Entry(NamedTuple):
    """Entry of a log: a data frame, a remote frame or an error frame."""

    channel: str
    frame: Frame
    remote: bool = False
    error: bool = False


@dataclass
class BusLog(ABC):
    """A log; the counts are those of the last reading through.

    `zone` is the time zone of the computer that recorded it, for logs in local time; None: UTC.
    """

    path: Path
    channel: str | None = None  # read this one; None: the log must hold one only
    zone: tzinfo | None = None
    clock: Clock = Clock.EPOCH
    lines: int = 0  # or entries, where the log has no lines
    remote: int = 0  # frames that ask for data
    errors: int = 0  # frames that report errors of the bus
    others: int = 0  # frames of other channels
    damaged: int = 0  # lines that are not frames
    lost_steps: int = 0  # damaged lines without a stamp, to which the next relative stamps add
    broken: str = ""  # why reading ended before the log did
    channels: Counter[str] = field(default_factory=Counter)  # frames by channel
    events: Counter[str] = field(default_factory=Counter)  # lines of other kinds, by kind
    set_back: int = 0  # times that a data frame is older than the one before it
    furthest_back: int = 0  # ns, by which it is at most
    behind: int = 0  # data frames older than one before them, since the clock was set back
    newest: int = 0  # ns, stamp

    @property
    def size(self) -> int:
        files = self.path.iterdir() if self.path.is_dir() else [self.path]
        return sum(file.stat().st_size for file in files)

    @property
    def stamps(self) -> Clock:
        """Origin of the stamps of its frames: those in local time of a known zone are in UTC."""
        known = self.clock is Clock.LOCAL and self.zone is not None
        return Clock.EPOCH if known else self.clock

    @abstractmethod
    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Everything, in the order of the log, counting `lines` and `damaged`."""

    def frames(self, on_bytes: Callable[[int], object] = lambda _: None) -> Iterator[Frame]:
        """The data frames, in the order of the log; `DataError` if it holds several channels.

        `on_bytes` is told how many bytes were read since the last time: progress.
        """
        self.lines = self.remote = self.errors = self.others = self.damaged = self.lost_steps = 0
        self.set_back = self.furthest_back = self.behind = self.newest = 0
        self.channels.clear()
        self.events.clear()
        self.broken = ""
        previous = 0
        only = self.channel
        try:
            for entry in self.entries(on_bytes):
                self.channels[entry.channel] += 1
                only = entry.channel if only is None else only
                if only != entry.channel:
                    self.others += 1
                elif self.others and self.channel is None:
                    continue  # refused below, when all channels are known
                elif entry.error:
                    self.errors += 1
                elif entry.remote:
                    self.remote += 1
                else:
                    if entry.frame.stamp < EARLIEST:
                        self.clock = Clock.START
                    self._follow(previous, entry.frame.stamp)
                    previous = entry.frame.stamp
                    yield entry.frame
        except (EOFError, zlib.error) as error:  # compressed, and cut off or damaged
            self.broken = str(error)
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read: {error.strerror or error}") from None
        if self.others and self.channel is None:
            *names, last = sorted(self.channels)
            raise DataError(
                f"{self.path}: the log holds frames of channels {', '.join(names)} and {last}; "
                f"say which one to read, for example --channel {names[0]}"
            )

    @property
    def back_in_words(self) -> str:
        """How time goes back in the log; empty if it does not."""
        if not self.set_back:
            return ""
        return (
            f"time goes back {self.set_back} times, by up to {self.furthest_back / NANOSECONDS:.3g}"
            f" s; {self.behind} frames are older than one before them"
        )

    def _follow(self, previous: int, stamp: int) -> None:
        """Count how time goes back; if by more than frames overtake one another, begin anew."""
        if stamp < previous:
            self.set_back += 1
            self.furthest_back = max(self.furthest_back, previous - stamp)
        self.behind += stamp < self.newest
        if stamp < self.newest - MAX_JUMP_NS:
            self.newest = stamp
        self.newest = max(self.newest, stamp)


def content(path: Path) -> BinaryIO:
    """The file, decompressed if it is compressed by gzip."""
    file = path.open("rb")
    compressed = file.read(len(GZIP)) == GZIP
    file.seek(0)
    return cast(BinaryIO, gzip.GzipFile(fileobj=file)) if compressed else file


def encoding_of(beginning: bytes) -> str | None:
    """Encoding of a text by its byte order mark, or by the zeros of UTF-16; None if it has none."""
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if beginning.startswith(mark):
            return encoding
    if b"\0" in beginning[:2]:
        return "utf-16-be" if beginning[:1] == b"\0" else "utf-16-le"
    return None


def text_encoding(file: BinaryIO) -> str:
    """Encoding of a text file by its first two bytes: UTF-16, or else UTF-8."""
    beginning = file.read(2)
    file.seek(0)
    return encoding_of(beginning) or "utf-8-sig"


def nanoseconds(date: datetime, zone: tzinfo | None) -> int:
    """A date without a zone as nanoseconds since 1970: of `zone`, None: of UTC."""
    return (date.replace(tzinfo=zone or UTC) - EPOCH) // timedelta(microseconds=1) * 1000
