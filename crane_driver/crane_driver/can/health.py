"""Judgement of the bus: frames late or lost, commands not taken, and foreign valve frames."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from crane_driver import constants
from crane_driver.can.codec import Decoder, Readings, lost_frames
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout, MessageLayout
from crane_driver.can.mapping import Timing
from crane_driver.faults import UNUSABLE, Fault, FaultKind

ANOTHER_COMMANDS = "another node commands the valves ({said})"
OWN_FRAME_RETURNED = (
    "a valve frame of this driver came back ({said}): a gateway or a recording repeats it, a "
    "second driver sends the same, or the interface returns what it sends (receive_own_messages); "
    "only one may command the valves"
)


class Freshness(IntEnum):
    """How long ago the last good frame came."""

    FRESH = 0
    LATE = 1
    MISSING = 2


@dataclass(slots=True)
class MessageStream:
    """State of the frames of one message."""

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
            message.name: MessageStream(
                message, timing.late * message.cycle, timing.missing * message.cycle, start
            )
            for message in messages
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
        """Return whether every message has come, and none is late by the last `check`."""
        return all(
            stream.received and stream.freshness is Freshness.FRESH
            for stream in self.streams.values()
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


@dataclass(slots=True)
class _Sent:
    """Frames of one command message, as far as they are known."""

    layout: MessageLayout
    since: float = math.inf  # s, steady: when the first frame was sent that nothing answers yet
    frames: int = 0  # sent since the last echo
    echo: int | None = None


class Acceptance:
    """Compares command frames that were sent with the counters of those that were accepted.

    Every echo must have moved on since the last one if frames were sent meanwhile. When it has
    not done so for `timeout` [s], frames do not get through: the machine does not hear them, or
    finds them wrong.
    """

    def __init__(self, layout: Layout, timeout: float):
        self._timeout = timeout
        self._echoing = {message.name: message for message in layout.readings if message.echoes}
        self._sent = {
            (message.message.frame_id, message.message.is_extended_frame): _Sent(message)
            for message in layout.commands
        }
        self._by_name = {sent.layout.name: sent for sent in self._sent.values()}

    def sent(self, frame: Frame, now: float) -> None:
        sent = self._sent[frame.id, frame.extended]
        sent.frames += 1
        sent.since = min(sent.since, now)

    def observe(self, readings: Readings) -> list[Fault]:
        """Faults that a frame with echoes shows; again after each `timeout` in which they last."""
        if not readings.accepted:
            return []
        layout = self._echoing[readings.message]
        faults = []
        for command, echo in readings.accepted.items():
            sent = self._by_name[command]
            rounds, rest = divmod(sent.frames, sent.layout.protection.counter_count)
            moved = echo != sent.echo or (rounds > 0 and rest == 0)  # whole rounds cannot be seen
            waited = readings.steady - sent.since
            if moved:
                sent.since = math.inf
            elif waited > self._timeout:
                sent.since = readings.steady
                faults.append(
                    layout.fault(
                        FaultKind.NOT_ACCEPTED,
                        f"{command} has been sent for {waited * 1e3:.0f} ms and none was accepted "
                        f"(counter {echo}), limit {self._timeout * 1e3:.0f} ms",
                    )
                )
            sent.echo, sent.frames = echo, 0
        return faults


class ForeignCommands:
    """Watch for valve commands of others: the link leaves out its own echoes."""

    def __init__(self, layout: Layout):
        self._decoder = Decoder(layout.commands)
        self._own: deque[Frame] = deque(maxlen=constants.REMEMBERED_FRAMES)

    def sent(self, frame: Frame) -> None:
        self._own.append(frame)

    def observe(self, frame: Frame) -> Fault | None:
        """The fault that a received frame is; None if it is no valve command."""
        layout = self._decoder.layout_of(frame)
        if layout is None:
            return None
        again = any(
            (own_frame.id, own_frame.data) == (frame.id, frame.data) for own_frame in self._own
        )
        said = (OWN_FRAME_RETURNED if again else ANOTHER_COMMANDS).format(said=self._said(frame))
        return layout.fault(FaultKind.FOREIGN, said)

    def _said(self, frame: Frame) -> str:
        readings = self._decoder.decode(frame)
        if readings is None or not readings.commands:
            return f"data {frame.data.hex(' ')}"
        commands = ", ".join(f"{joint} {value:.3g}" for joint, value in readings.commands.items())
        if readings.enabled is None:
            return commands
        return f"{commands}; {'enabled' if readings.enabled else 'not enabled'}"


class HeardCommand(NamedTuple):
    """Commands of all valves after a frame, as far as they are known."""

    stamp: int  # ns, of reception
    commands: dict[str, float]  # joint: -1 to 1; NaN where it is not known


class HeardCommands:
    """Commands of others to the valves, put together from their frames.

    A valve keeps to its last command; after a silence of its message (`timing.missing`) its command
    is not known. Valves that are not enabled are neutral, whatever the frame says.
    """

    def __init__(self, layout: Layout):
        self._decoder = Decoder(layout.commands)
        self.unknown = self._decoder.unknown  # frames that are not valve commands, by identifier
        self.conflicts = self._decoder.conflicts  # identifiers of two devices, by valve command
        self._layouts = {message.name: message for message in layout.commands}
        self._missing = layout.timing.missing  # cycles
        self._heard: dict[str, float] = {}  # s, steady, by message
        self._commands = dict.fromkeys(layout.valves, math.nan)

    def observe(self, frame: Frame) -> tuple[HeardCommand | None, list[Fault]]:
        """The commands after a frame, None if it says nothing of them; and its faults."""
        readings = self._decoder.decode(frame)
        if readings is None:
            return None, []
        if not any(fault.kind in UNUSABLE for fault in readings.faults):
            self._heard[readings.message] = frame.steady
            for name in _valves(self._layouts[readings.message]):
                value = readings.commands.get(name, math.nan)
                self._commands[name] = 0.0 if readings.enabled is False else value
            for message, since in self._heard.items():
                layout = self._layouts[message]
                if frame.steady - since > self._missing * layout.cycle:
                    self._commands |= dict.fromkeys(_valves(layout), math.nan)
            return HeardCommand(frame.stamp, dict(self._commands)), readings.faults
        return None, readings.faults


def _valves(layout: MessageLayout) -> set[str]:
    return {channel.name for channel in layout.commands}
