"""Logs of Vector's tools in text (ASC), read line by line.

Unlike python-can's reader it adds up relative stamps, numbers channels as the file does, reads the
same stamps on every computer, keeps them exact, and counts the lines that it cannot use.
"""

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime

from can.util import dlc2len

from crane_driver.can.bus_log import BusLog, Clock, Entry, content, nanoseconds
from crane_driver.can.frame import Frame

STAMP = r"(?P<sign>-?)(?P<seconds>\d+)[.,](?P<fraction>\d{1,9})"
IDENTIFIER = r"(?P<id>[0-9a-f]+)(?P<extended>x?)"
DIRECTION = r"(?P<direction>rx|tx|txrq)"
FRAMES = (
    rf"(?P<channel>\d+)\s+{IDENTIFIER}\s+{DIRECTION}\s+(?P<kind>[dr])"
    r"(?:\s+(?P<dlc>[0-9a-f]{1,2}))?(?P<data>(?:\s.*)?)",
    rf"CANFD\s+(?P<channel>\d+)\s+{DIRECTION}\s+{IDENTIFIER}\s+(?:[a-z_]\S*\s+)?[01]\s+[01]\s+"
    r"(?P<dlc>[0-9a-f]{1,2})\s+(?P<length>\d{1,2})(?P<data>(?:\s.*)?)",
    rf"CANFD\s+(?P<channel>\d+)\s+{IDENTIFIER}\s+{DIRECTION}\s+[01]\s+[01]\s+(?P<kind>[dr])\s+"
    r"(?P<dlc>[0-9a-f]{1,2})(?:\s+(?P<length>\d{1,2}))?(?P<data>(?:\s.*)?)",
)
ERROR = r"(?:CANFD\s+)?(?P<channel>\d+)\s+(?:(?:rx|tx)\s+)?errorframe\b.*"
EVENTS = {
    "status lines": r"CAN\s+\d+\s+status.*",
    "statistic lines": r"\d+\s+statistic.*",
    "lines of the J1939 transport protocol": r"\d+\s+J1939TP.*",
    "frames with a name in the place of the identifier": (
        r"(?:CANFD\s+)?\d+\s+(?:(?:rx|tx)\s+)?(?![0-9a-f]+x?\s)[a-z_]\S*\s+"
        r"(?:(?:rx|tx)\s+[dr]\b|[01]\s+[01]\s).*"
    ),
    "lines of other events": r"(?!CANFD\s+\d)[^\d\s].*|\d+\s+(?![0-9a-f]*x?\s)[a-z_].*",
}
LINE = re.compile(rf"{STAMP}(?:\s+(?P<rest>.*))?")
FRAME = tuple(re.compile(one, re.IGNORECASE) for one in FRAMES)
ERROR_FRAME = re.compile(ERROR, re.IGNORECASE)
EVENT = {name: re.compile(one, re.IGNORECASE) for name, one in EVENTS.items()}
SENT = "requests to transmit"

DATE = re.compile(r"date\s+(?P<date>.*)", re.IGNORECASE)
FORMAT = re.compile(
    r"(?=base|timestamps)(?:base\s+(?P<base>hex|dec)\b\s*)?"
    r"(?:timestamps\s+(?P<stamps>absolute|relative)\b)?",
    re.IGNORECASE,
)
BLOCK = re.compile(r"begin\s+triggerblock\b(?P<date>.*)", re.IGNORECASE)
REMARK = re.compile(
    r"//.*|(no\s+)?internal\s+events\s+logged.*|end\s+triggerblock.*", re.IGNORECASE
)
MOMENT = re.compile(
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
HIGHEST_STANDARD, HIGHEST = 0x7FF, 0x1FFFFFFF
CLASSIC = 8  # bytes


@dataclass
class AscLog(BusLog):
    """A log of Vector's CANoe, CANalyzer and loggers, or of tools that write the same text.

    Stamps count from the date in the header, or from that of a trigger block in which they begin
    anew; `timestamps relative` are differences to the line before.
    """

    clock: Clock = Clock.LOCAL

    def entries(self, on_bytes: Callable[[int], object]) -> Iterator[Entry]:
        """Line by line."""
        self.clock = Clock.LOCAL
        time = _Time(self)
        base = 16
        with io.TextIOWrapper(content(self.path), "utf-8-sig", errors="replace") as file:
            for line in file:
                on_bytes(len(line))
                if not (text := line.strip()):
                    continue
                self.lines += 1
                if match := LINE.fullmatch(text):
                    stamp = time.stamp(match)
                    if (entry := self._entry(match["rest"] or "", stamp, base)) is not None:
                        yield entry
                elif match := FORMAT.match(text):
                    if match["base"]:
                        base = 10 if match["base"].lower() == "dec" else 16
                    if match["stamps"]:
                        time.relative = match["stamps"].lower() == "relative"
                elif match := DATE.fullmatch(text):
                    time.start(match["date"])
                elif match := BLOCK.fullmatch(text):
                    time.block(match["date"])
                elif not REMARK.fullmatch(text):
                    self.damaged += 1
                    self.lost_steps += time.relative

    def _entry(self, text: str, stamp: int, base: int) -> Entry | None:
        """Frame of a line, behind its stamp; None, and counted, if it is not a whole frame."""
        for pattern in FRAME:
            if match := pattern.fullmatch(text):
                if match["direction"].lower() == "txrq":
                    self.events[SENT] += 1  # the frame itself follows
                    return None
                if entry := _frame(match.groupdict(), stamp, base):
                    return entry
                self.damaged += 1
                return None
        if match := ERROR_FRAME.fullmatch(text):
            return Entry(match["channel"], Frame(0, b"", False, stamp, stamp / 1e9), error=True)
        kind = next((name for name, pattern in EVENT.items() if pattern.fullmatch(text)), None)
        if kind is None:
            self.damaged += 1
        else:
            self.events[kind] += 1
        return None


class _Time:
    """From the stamps of the lines to time [ns]."""

    def __init__(self, log: AscLog):
        self._log = log
        self.relative = False
        self._origin = 0  # ns, what the next stamp adds to
        self._block: int | None = None  # ns, date of a block of which no stamp was read so far

    def start(self, date: str) -> None:
        """The date of the header."""
        self._origin = self._read(date) or 0

    def block(self, date: str) -> None:
        """The date of a trigger block."""
        self._block = self._read(date)

    def stamp(self, match: re.Match[str]) -> int:
        """Time of a line."""
        since = int(match["seconds"]) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))
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
        match = MOMENT.search(text)
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


def _frame(found: dict[str, str | None], stamp: int, base: int) -> Entry | None:
    """The frame of a line; None if it is damaged."""
    channel, digits = found["channel"], found["id"]
    assert channel is not None and digits is not None
    try:
        identifier, dlc = int(digits, base), int(found["dlc"] or "0", base)
        remote = (found.get("kind") or "d").lower() == "r"
        if found.get("length") is not None:
            length = int(found["length"] or "0")
            remote = remote or (length == 0 < dlc)
        else:
            length = min(dlc2len(dlc), CLASSIC)
        shown = [] if remote else (found["data"] or "").split()[:length]
        data = bytes(int(byte, base) for byte in shown)
    except ValueError:  # no number of this base, or none of a byte
        return None
    if identifier > HIGHEST or (len(data) < length and not remote):
        return None
    extended = bool(found["extended"]) or identifier > HIGHEST_STANDARD
    return Entry(channel, Frame(identifier, data, extended, stamp, stamp / 1e9), remote)
