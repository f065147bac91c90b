"""What every bus log is, whatever its format: data frames, and counts of what is beside them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

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

    @abstractmethod
    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Everything, in the order of the log, counting `lines` and `damaged`."""

    def frames(self, on_bytes: Callable[[int], object] = lambda _: None) -> Iterator[Frame]:
        """The data frames, in the order of the log; `DataError` if it holds several channels.

        `on_bytes` is told how many bytes were read since the last time: progress.
        """
        self.lines = self.remote = self.errors = self.others = self.damaged = 0
        self.broken = ""
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
                    yield entry.frame
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read: {error.strerror}") from None

    def _select(self, channel: str, only: str | None) -> str:
        if self.channel is None and only not in (None, channel):
            raise DataError(
                f"{self.path}: the log holds frames of channels {only} and {channel}; "
                "say which one to read"
            )
        return channel if only is None else only
