"""Bus logs as `candump -l` writes them, read frame by frame.

Unlike python-can's reader it keeps the stamps exact, goes on after a damaged line, and does not
take the error frames of SocketCAN for data.
"""

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from crane_driver.can.bus_log import BusLog, Entry, content
from crane_driver.can.frame import Frame

LINE = re.compile(
    r"\((?P<seconds>\d+)\.(?P<fraction>\d{1,9})\)\s+(?P<channel>\S+)\s+"
    r"(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(?:#[0-9A-Fa-f])?(?P<remote>R)?(?P<data>(?:[0-9A-Fa-f]{2}){0,64})"
    r"(?(remote)[0-9A-Fa-f]{0,2}|)(?:\s+[RT])?"
)
ERROR_FLAG = 0x20000000  # CAN_ERR_FLAG
IDENTIFIER = 0x1FFFFFFF


@dataclass
class CandumpLog(BusLog):
    """A log of `candump -l`."""

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Line by line."""
        with io.TextIOWrapper(content(self.path), "ascii", errors="replace") as file:
            for line in file:
                on_bytes(len(line))
                if not (text := line.strip()):
                    continue
                self.lines += 1
                if match := LINE.fullmatch(text):
                    yield _entry(match)
                else:
                    self.damaged += 1


def _entry(match: re.Match[str]) -> Entry:
    number, extended = int(match["id"], 16), len(match["id"]) == 8
    stamp = int(match["seconds"]) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))
    data = bytes.fromhex(match["data"])
    frame = Frame(number & IDENTIFIER, data, extended, stamp, stamp / 1e9)
    error = extended and bool(number & ERROR_FLAG)
    return Entry(match["channel"], frame, remote=match["remote"] is not None, error=error)
