"""From received frames to values."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cantools.database import DecodeError
from cantools.j1939 import pgn_from_frame_id

from crane_driver.can.dbc import addressed, code_of
from crane_driver.can.encoder import SignalBits, frame_crc
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.layout import Channel, MessageLayout, ValveChannel
from crane_driver.faults import Fault, FaultKind

# When a device took its readings, from when their frames were received.

WINDOW = 10.0  # s over which the clock of a device is followed
LEARNT = 1.0  # s after which it is relied on
PROMPT_TIMEOUT_S = 1.0  # in which one frame comes without delay, or the clock has changed
LEAST = 0.1  # cycles between two instants of sampling
Cycle = tuple[int, float]  # number, reception [s, steady]


class SamplingClock:
    """The even clock by which a device samples, seen through receptions that are late at times.

    A frame is never early: over the number of its cycle, receptions lie on or above the straight
    line of the device's clock, and the frames without delay lie on it. That line is the edge of the
    lower convex hull of the last receptions below their middle, which follows any drift of the two
    clocks. Source: Zhang, Liu, Xia, Clock synchronization algorithms for network measurements,
    IEEE INFOCOM 2002.
    """

    def __init__(self, cycle: float):
        """cycle: nominal, [s]."""
        self._cycle = cycle
        self._last = -math.inf
        self._begin()

    def sampled(self, number: int, received: float) -> float:
        """When cycle `number` was sampled [s, steady], but for the delay that all frames have.

        Numbers and receptions [s, steady] increase from call to call. Never later than `received`,
        and the same as long as the clock is not known.
        """
        self._extend((number, received))
        sampled = received
        if received - self._hull[0][1] >= LEARNT:
            sampled = min(received, self._line(number))
        if received - sampled < self._cycle / 2:
            self._prompt = received
        elif received - self._prompt > PROMPT_TIMEOUT_S:
            self._begin()
            sampled = received
        self._last = min(received, max(sampled, self._last + LEAST * self._cycle))
        return self._last

    def _begin(self) -> None:
        self._hull: list[Cycle] = []
        self._prompt = -math.inf  # reception of the last frame without delay

    def _extend(self, new: Cycle) -> None:
        """Add a point to the hull, whose edges become steeper from left to right."""
        hull = self._hull
        while len(hull) > 1 and _slope(hull[-2], new) <= _slope(hull[-2], hull[-1]):
            hull.pop()
        hull.append(new)
        while len(hull) > 1 and new[1] - hull[0][1] > WINDOW and hull[1][1] < new[1] - LEARNT:
            hull.pop(0)

    def _line(self, number: int) -> float:
        """The edge below the middle of the window, prolonged to `number`."""
        middle = (self._hull[0][0] + self._hull[-1][0]) / 2
        right = next(i for i, point in enumerate(self._hull) if point[0] >= middle)
        left = self._hull[right - 1]
        return left[1] + _slope(left, self._hull[right]) * (number - left[0])


def _slope(left: Cycle, right: Cycle) -> float:
    """Seconds a cycle."""
    return (right[1] - left[1]) / (right[0] - left[0])


@dataclass(slots=True)
class Readings:
    """What one frame holds, in SI units. Values that are no measurements are absent, and `faults`
    say why; a frame of the wrong size or with a wrong checksum holds none.
    """

    message: str
    stamp: int  # ns, of reception
    steady: float  # s, of reception
    counter: int | None = None
    positions: dict[str, float] = field(default_factory=dict)  # joint: rad, m
    pressures: dict[str, float] = field(default_factory=dict)  # JOINT.a, ..., supply, tank: Pa
    commands: dict[str, float] = field(default_factory=dict)  # joint: -1 to 1
    enabled: bool | None = None
    states: dict[str, str] = field(default_factory=dict)
    accepted: dict[str, int] = field(default_factory=dict)  # command message: counter given back
    faults: list[Fault] = field(default_factory=list)


class _Source:
    """One message of a layout, and the identifier that its frames have, once that is known."""

    def __init__(self, layout: MessageLayout):
        self.layout, self.bits = layout, SignalBits(layout.message)
        self.identifier = layout.message.frame_id if layout.group is None else None


class Decoder:
    """Decodes the messages of one side of a layout: its `readings` or its `commands`.

    Identifiers must match; only the source address of a J1939 message may be a placeholder, in the
    place of that of the one device that sends it. Two senders of one group must not feed one
    reading: `conflicts` names them, by message, and frames of the second hold a fault.
    """

    def __init__(self, messages: Sequence[MessageLayout]):
        self.unknown: Counter[tuple[int, bool]] = Counter()  # frames per unknown identifier
        self.conflicts: dict[str, tuple[str, str]] = {}
        sources = [_Source(one) for one in messages]
        self._sources = {
            (one.layout.message.frame_id, one.layout.message.is_extended_frame): one
            for one in sources
        }
        self._of_group = {one.layout.group: one for one in sources if one.layout.group is not None}
        # parts of valve commands by joint and signal: those of a pair may be in two messages
        self._parts: dict[str, dict[tuple[str, str], float | None]] = {}
        for one in messages:
            for channel in one.commands:
                self._parts.setdefault(channel.name, {})[one.name, channel.signal] = None

    def decode(self, frame: Frame) -> Readings | None:
        """Values of a frame; None, and counted, where the identifier is not of the layout."""
        source = self._source(frame)
        if source is None:
            self.unknown[frame.id, frame.extended] += 1
            return None
        if source.identifier is None:
            source.identifier = frame.id
        elif source.identifier != frame.id:
            return self._conflict(source, frame)
        layout = source.layout
        readings = Readings(layout.name, frame.stamp, frame.steady)
        if fault := _damage(layout, frame.data):
            readings.faults.append(fault)
            return readings
        try:
            # neither names nor scales: the channels hold sign, unit, scale and zero in one
            raw = source.bits.unpack(frame.data)
        except DecodeError as error:  # a multiplexer value that the DBC does not have
            readings.faults.append(layout.fault(FaultKind.OUT_OF_RANGE, str(error)))
            return readings
        _read(layout, layout.positions, raw, readings.positions, readings.faults)
        _read(layout, layout.pressures, raw, readings.pressures, readings.faults)
        self._read_commands(layout, raw, readings)
        if layout.enable:
            readings.enabled = raw[layout.enable] == 1  # of two bits, 2 and 3 are codes
        if layout.protection.counter:
            readings.counter = raw.get(layout.protection.counter)
        for echo in layout.echoes:
            if echo.signal in raw:
                readings.accepted[echo.command] = raw[echo.signal]
        _read_states(layout, raw, readings)
        return readings

    def layout_of(self, frame: Frame) -> MessageLayout | None:
        """The message that a frame is, whoever sends it; None if it is none of the layout."""
        source = self._source(frame)
        return source.layout if source else None

    def _source(self, frame: Frame) -> _Source | None:
        source = self._sources.get((frame.id, frame.extended))
        if source is None and frame.extended and self._of_group:
            source = self._of_group.get(pgn_from_frame_id(frame.id))
            if source is not None and not addressed(source.layout.message, frame.id):
                return None
        return source

    def _conflict(self, source: _Source, frame: Frame) -> Readings:
        layout = source.layout
        assert source.identifier is not None  # or there would be no conflict
        senders = show_id(source.identifier, True), show_id(frame.id, True)
        self.conflicts[layout.name] = senders
        fault = layout.fault(
            FaultKind.REPEATED, f"{senders[0]} and {senders[1]} both send it, the DBC names neither"
        )
        advice = "write the id of the device that is meant into the DBC"
        return Readings(
            layout.name, frame.stamp, frame.steady, faults=[replace(fault, advice=advice)]
        )

    def _read_commands(
        self, layout: MessageLayout, raw: Mapping[str, Any], readings: Readings
    ) -> None:
        for channel in layout.commands:
            value = _value(layout, channel, raw, readings.faults)
            if value is not None:
                value = _directed(layout, channel, value, raw, readings.faults)
            self._parts[channel.name][layout.name, channel.signal] = value
        for name in {channel.name for channel in layout.commands}:
            parts = [one for one in self._parts[name].values() if one is not None]
            if len(parts) == len(self._parts[name]):
                readings.commands[name] = min(max(sum(parts), -1.0), 1.0)


def _damage(layout: MessageLayout, data: bytes) -> Fault | None:
    if len(data) != layout.message.length:
        return layout.fault(
            FaultKind.WRONG_SIZE, f"{len(data)} bytes, the DBC says {layout.message.length}"
        )
    protection = layout.protection
    if protection.crc:
        expected = frame_crc(data, protection.crc_byte, protection.data_id)
        if data[protection.crc_byte] != expected:
            return layout.fault(
                FaultKind.CHECKSUM,
                f"{protection.crc} is 0x{data[protection.crc_byte]:02X}, "
                f"the frame has 0x{expected:02X}",
            )
    return None


def _read(
    layout: MessageLayout,
    channels: tuple[Channel, ...],
    raw: Mapping[str, Any],
    values: dict[str, float],
    faults: list[Fault],
) -> None:
    for channel in channels:
        value = _value(layout, channel, raw, faults)
        if value is not None:
            values[channel.name] = value


def _value(
    layout: MessageLayout, channel: Channel, raw: Mapping[str, Any], faults: list[Fault]
) -> float | None:
    """SI value; None where there is none: not in this frame, or a fault that is noted."""
    count = raw.get(channel.signal)
    if count is None:  # multiplexed
        return None
    value: float = channel.gain * count + channel.offset
    if channel.fault and raw.get(channel.fault):
        detail = f"{channel.name}: {channel.fault} is set"
        faults.append(layout.fault(FaultKind.SENSOR, detail, channel.name))
        return None
    if channel.low <= value <= channel.high:
        return value
    if code := code_of(channel.code_bits, count):
        detail = f"{channel.name}: {channel.signal} is 0x{count:X}, which means {code}"
        faults.append(layout.fault(FaultKind.SENSOR, detail, channel.name))
        return None
    faults.append(
        layout.fault(
            FaultKind.OUT_OF_RANGE,
            f"{channel.name} is {value:g}, {channel.signal} goes from {channel.low:g} "
            f"to {channel.high:g}",
            channel.name,
        )
    )
    return None


def _directed(
    layout: MessageLayout,
    channel: ValveChannel,
    value: float,
    raw: Mapping[str, Any],
    faults: list[Fault],
) -> float | None:
    """Command of a magnitude; None, and a fault noted, if its direction says nothing of a way."""
    if channel.direction is None:
        return value
    count = raw[channel.direction.signal]
    sign = channel.direction.sign(int(count))
    if sign is None:
        detail = f"{channel.direction.signal} of {channel.name} is {count}, which is no direction"
        faults.append(layout.fault(FaultKind.STATE, detail, channel.name))
        return None
    return sign * value


def _read_states(layout: MessageLayout, raw: Mapping[str, Any], readings: Readings) -> None:
    for state in layout.states:
        number = raw.get(state.signal)
        if number is None:
            continue
        label = state.label(int(number))
        readings.states[state.name] = label
        if number not in state.healthy:
            readings.faults.append(layout.fault(FaultKind.STATE, f"{state.name} is {label}"))
