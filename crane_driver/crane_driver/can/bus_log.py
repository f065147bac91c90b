"""What every bus log is, whatever its format: data frames, and counts of what is beside them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from crane_bags.clocks import LARGEST_JUMP, NANOSECONDS
from crane_driver.can.frame import Frame
from crane_model.errors import DataError


class Entry(NamedTuple):
    """What a log holds: a data frame, or one that asks for data or reports an error of the bus."""

    channel: str
    frame: Frame
    remote: bool = False
    error: bool = False


@dataclass
class BusLog(ABC):
    """A log; the counts are those of the last reading through."""

    path: Path
    channel: str | None = None  # read this one; None: the log must hold one only
    lines: int = 0  # or entries, where the log has no lines
    remote: int = 0  # frames that ask for data
    errors: int = 0  # frames that report errors of the bus
    others: int = 0  # frames of other channels
    damaged: int = 0  # lines that are not frames
    broken: str = ""  # why reading ended before the log did
    set_back: int = 0  # times that a data frame is older than the one before it
    furthest_back: int = 0  # ns, by which it is at most
    behind: int = 0  # data frames older than one before them, though the clock was not set
    newest: int = 0  # ns, stamp

    @abstractmethod
    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Everything, in the order of the log, counting `lines` and `damaged`."""

    def frames(self, on_bytes: Callable[[int], object] = lambda _: None) -> Iterator[Frame]:
        """The data frames, in the order of the log; `DataError` if it holds several channels.

        `on_bytes` is told how many bytes were read since the last time: progress.
        """
        self.lines = self.remote = self.errors = self.others = self.damaged = 0
        self.set_back = self.furthest_back = self.behind = self.newest = 0
        self.broken = ""
        previous = 0
        only = self.channel
        try:
            for entry in self.entries(on_bytes):
                only = self._select(entry.channel, only)
                if only != entry.channel:
                    self.others += 1
                elif entry.error:
                    self.errors += 1
                elif entry.remote:
                    self.remote += 1
                else:
                    self._follow(previous, entry.frame.stamp)
                    previous = entry.frame.stamp
                    yield entry.frame
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read: {error.strerror}") from None

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
        if stamp < self.newest - LARGEST_JUMP:
            self.newest = stamp
        self.behind += stamp < self.newest
        self.newest = max(self.newest, stamp)

    def _select(self, channel: str, only: str | None) -> str:
        if self.channel is None and only not in (None, channel):
            raise DataError(
                f"{self.path}: the log holds frames of channels {only} and {channel}; "
                "say which one to read"
            )
        return channel if only is None else only
