"""Judgement of the stream of frames: late, missing, repeated, lost; pure, by the steady clock."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from crane_driver.can.decoder import Readings
from crane_driver.can.layout import MessageLayout
from crane_driver.can.mapping import Timing
from crane_driver.can.protection import lost_frames
from crane_driver.faults import UNUSABLE, Fault, FaultKind


class Freshness(IntEnum):
    """How long ago the last good frame came."""

    FRESH = 0
    LATE = 1
    MISSING = 2


@dataclass(slots=True)
class MessageStream:
    """What is known of the frames of one message."""

    layout: MessageLayout
    late: float  # s, gaps beyond are late
    missing: float  # s, likewise
    last: float  # s, steady, last good frame, or the start
    freshness: Freshness = Freshness.FRESH
    counter: int | None = None
    received: int = 0  # good frames
    refused: int = 0  # wrong size, checksum, repeated
    lost: int = 0  # by the counter
    longest_gap: float = 0.0  # s


class Monitor:
    """Watches messages from `start` [s, steady] on; reports each silence once.

    The driver watches the `readings` of its layout, the machine the `commands`.
    """

    def __init__(self, messages: Sequence[MessageLayout], timing: Timing, start: float):
        self._timing = timing
        self.streams = {
            one.name: MessageStream(one, timing.late * one.cycle, timing.missing * one.cycle, start)
            for one in messages
        }

    def observe(self, readings: Readings) -> list[Fault]:
        """Faults that a frame shows; its values may be used unless one of them is `UNUSABLE`."""
        stream = self.streams[readings.message]
        faults = list(readings.faults)
        if usable(faults):
            faults += self._sequence(stream, readings.counter)
        if not usable(faults):
            stream.refused += 1
            return faults
        gap = readings.steady - stream.last
        if gap > stream.late and stream.freshness is Freshness.FRESH:
            faults.append(_late(stream, gap))
        if stream.received and gap > stream.longest_gap:
            stream.longest_gap = gap
        stream.received += 1
        stream.last = readings.steady
        stream.freshness = Freshness.FRESH
        return faults

    def check(self, now: float) -> list[Fault]:
        """Faults that show by frames not coming, at `now` [s, steady]."""
        faults = []
        for stream in self.streams.values():
            gap = now - stream.last
            if gap > stream.missing and stream.freshness < Freshness.MISSING:
                stream.freshness = Freshness.MISSING
                stream.counter = None  # whoever comes back may count anew
                since = "the last one" if stream.received else "the start, not one yet"
                faults.append(
                    stream.layout.fault(
                        FaultKind.MISSING, f"no frame for {gap * 1e3:.0f} ms since {since}"
                    )
                )
            elif gap > stream.late and stream.freshness < Freshness.LATE:
                stream.freshness = Freshness.LATE
                faults.append(_late(stream, gap))
        return faults

    @property
    def complete(self) -> bool:
        """Whether every message has come, and none is late by the last `check`."""
        return all(
            one.received and one.freshness is Freshness.FRESH for one in self.streams.values()
        )

    def _sequence(self, stream: MessageStream, counter: int | None) -> Sequence[Fault]:
        if counter is None:
            return ()
        protection = stream.layout.protection
        position = counter - protection.counter_first
        if not 0 <= position < protection.counter_count:
            last = protection.counter_first + protection.counter_count - 1
            return (
                stream.layout.fault(
                    FaultKind.SEQUENCE,
                    f"counter {counter}, it runs from {protection.counter_first} to {last}",
                ),
            )
        previous, stream.counter = stream.counter, counter
        if previous is None:
            return ()
        lost = lost_frames(previous, counter, protection.counter_count)
        if lost < 0:
            return (stream.layout.fault(FaultKind.REPEATED, f"counter {counter} came again"),)
        stream.lost += lost
        if lost > self._timing.lost:
            return (
                stream.layout.fault(
                    FaultKind.SEQUENCE,
                    f"{lost} frames lost in a row (counter {previous}, then {counter}), "
                    f"limit {self._timing.lost}",
                ),
            )
        return ()


def usable(faults: Sequence[Fault]) -> bool:
    """Return whether the values of a frame with these faults may be used."""
    return not faults or not any(fault.kind in UNUSABLE for fault in faults)


def _late(stream: MessageStream, gap: float) -> Fault:
    return stream.layout.fault(
        FaultKind.LATE,
        f"{gap * 1e3:.0f} ms since the last frame, cycle {stream.layout.cycle * 1e3:.0f} ms",
    )
