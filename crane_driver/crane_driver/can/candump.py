"""Bus logs as `candump -l` writes them, read frame by frame.

Unlike python-can's reader it keeps the stamps exact, goes on after a damaged line, and does not
take the error frames of SocketCAN for data.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from crane_driver.can.frame import Frame
from crane_model.errors import DataError

LINE = re.compile(
    r"\((?P<seconds>\d+)\.(?P<fraction>\d{1,9})\)\s+(?P<channel>\S+)\s+"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(?:#[0-9A-Fa-f])?(?P<remote>R)?(?P<data>(?:[0-9A-Fa-f]{2}){0,64})"
    r"(?(remote)[0-9A-Fa-f]{0,2}|)(?:\s+[RT])?"
)
ERROR_FLAG = 0x20000000  # CAN_ERR_FLAG
IDENTIFIER = 0x1FFFFFFF


@dataclass
class Log:
    """A log; the counts are those of the last reading through.

    `on_bytes` is told the length of each line: progress.
    """

    path: Path
    channel: str | None = None  # read this one; None: the log must hold one only
    lines: int = 0
    remote: int = 0  # frames that ask for data
    errors: int = 0  # frames that report errors of the bus
    others: int = 0  # frames of other channels
    damaged: int = 0  # lines that are not frames

    def frames(self, on_bytes: Callable[[int], object] = lambda _: None) -> Iterator[Frame]:
        """The data frames, in the order of the log; `DataError` if it holds several channels."""
        self.lines = self.remote = self.errors = self.others = self.damaged = 0
        only = self.channel
        try:
            with self.path.open(encoding="ascii", errors="replace") as file:
                for line in file:
                    on_bytes(len(line))
                    if not (text := line.strip()):
                        continue
                    self.lines += 1
                    match = LINE.fullmatch(text)
                    if match is None:
                        self.damaged += 1
                        continue
                    only = self._select(match["channel"], only)
                    if only == match["channel"] and (frame := self._frame(match)):
                        yield frame
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read: {error.strerror}") from None

    def _select(self, channel: str, only: str | None) -> str:
        if only is None or channel == only:
            return channel
        if self.channel is None:
            raise DataError(
                f"{self.path}: the log holds frames of channels {only} and {channel}; "
                "say which one to read"
            )
        self.others += 1
        return only

    def _frame(self, match: re.Match[str]) -> Frame | None:
        number, extended = int(match["id"], 16), len(match["id"]) == 8
        if extended and number & ERROR_FLAG:
            self.errors += 1
            return None
        if match["remote"]:
            self.remote += 1
            return None
        stamp = int(match["seconds"]) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))
        data = bytes.fromhex(match["data"])
        return Frame(number & IDENTIFIER, data, extended, stamp, stamp / 1e9)
