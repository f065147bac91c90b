"""Frames to values and back, at both ends of the bus: the driver, and the machine."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cantools.database import DecodeError
from cantools.database.can import Message, Signal
from cantools.database.utils import create_encode_decode_formats, start_bit
from cantools.j1939 import pgn_from_frame_id

from crane_driver.can.dbc import addressed
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.layout import Channel, Layout, MessageLayout, ValveChannel
from crane_driver.faults import Fault, FaultKind
from crane_model.errors import RangeError

POLYNOMIAL = 0x1D  # x^8 + x^4 + x^3 + x^2 + 1


class SignalBits:
    """Packs and unpacks all signals of a message at once, by the formats that cantools compiles.

    `Message.encode` and `Message.decode` do the same signal by signal, for ten times the time, and
    not if signals overlap. Multiplexed messages, whose signals depend on each other, are left to
    them.
    """

    def __init__(self, message: Message):
        self._message = message
        self._multiplexed = message.is_multiplexed()
        layers = [] if self._multiplexed else _layers(message)
        self._formats = [create_encode_decode_formats(layer, message.length) for layer in layers]
        self.overlap = len(layers) > 1

    def unpack(self, data: bytes) -> Mapping[str, Any]:
        """Raw value of each signal in `data`, which has the length of the message.

        `DecodeError` if a multiplexer has a value that the DBC does not have.
        """
        if self._multiplexed:
            return self._message.decode_simple(data, False, False)
        raw: dict[str, Any] = {}
        for formats in self._formats:
            raw.update(formats.little_endian.unpack(data[::-1]))
            raw.update(formats.big_endian.unpack(data))
        return raw

    def pack(self, raw: Mapping[str, float]) -> bytes:
        """The bytes with a raw value for each signal, none missing, whole numbers as `int`.

        If signals overlap, a bit is set if either signal sets it.
        """
        if self._multiplexed:
            return self._message.encode(raw, False, False, False)
        packed = 0
        for formats in self._formats:
            packed |= int.from_bytes(formats.little_endian.pack(raw)[::-1])
            packed |= int.from_bytes(formats.big_endian.pack(raw))
        return packed.to_bytes(self._message.length)


def _layers(message: Message) -> list[list[Signal]]:
    """Signals that do not overlap; more than one layer only where the message has some that do."""
    layers: list[tuple[list[Signal], set[int]]] = []
    for signal in message.signals:
        bits = _bits(signal)
        layer = next((layer for layer in layers if not layer[1] & bits), None)
        if layer is None:
            layer = [], set()
            layers.append(layer)
        layer[0].append(signal)
        layer[1].update(bits)
    return [signals for signals, _ in layers] or [[]]


def _bits(signal: Signal) -> set[int]:
    """Places of its bits, counted from the highest bit of the first byte."""
    begin = start_bit(signal)
    places = range(begin, begin + signal.length)
    if signal.byte_order == "big_endian":
        return set(places)
    return {place ^ 7 for place in places}


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


TABLE = bytes(_remainder(byte) for byte in range(256))


def crc8(data: bytes, start: int = 0) -> int:
    """Remainder of `data` by the polynomial of SAE J1850, from `start`, neither inverted.

    Sources: AUTOSAR, Specification of CRC Routines, for CRC-8 SAE J1850; AUTOSAR, E2E Protocol
    Specification, for profile 1 with both bytes of the data id.
    """
    table, crc = TABLE, start
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def sae_j1850(data: bytes) -> int:
    """CRC-8 SAE J1850: from 0xFF, inverted."""
    return crc8(data, 0xFF) ^ 0xFF


def autosar_e2e_1(data: bytes, data_id: int) -> int:
    """CRC of E2E profile 1 over the data id (16 bit, low byte first) and `data`."""
    return crc8(data, TABLE[TABLE[data_id & 0xFF] ^ (data_id >> 8)])


def frame_crc(data: bytes, position: int, data_id: int | None) -> int:
    """CRC of a frame over all its bytes but the one at `position`, which holds the CRC.

    By E2E profile 1 where there is a data id, else by SAE J1850 alone.
    """
    covered = data[:position] + data[position + 1 :]
    return sae_j1850(covered) if data_id is None else autosar_e2e_1(covered, data_id)


def lost_frames(previous: int, current: int, count: int) -> int:
    """Frames lost between two counters that run from 0 to count - 1: 0 is right, -1 a repetition.

    A loss of `count` frames or more looks like a smaller one.
    """
    return (current - previous) % count - 1


class Encoder:
    """Encodes messages of a layout, and counts their counters on."""

    def __init__(self, messages: Sequence[MessageLayout]):
        self._counters = {message.name: message.protection.counter_first for message in messages}
        self._bits = {message.name: SignalBits(message.message) for message in messages}

    def encode(self, layout: MessageLayout, raw: Mapping[str, float]) -> Frame:
        """Frame with raw values (none missing, whole ones as `int`), next counter and checksum."""
        message, protection = layout.message, layout.protection
        values = dict(raw)
        if protection.counter:
            first, counter = protection.counter_first, self._counters[layout.name]
            values[protection.counter] = counter
            following = (counter + 1 - first) % protection.counter_count
            self._counters[layout.name] = first + following
        if protection.crc:
            values[protection.crc] = 0
        data = self._bits[layout.name].pack(values)
        if protection.crc:
            crc = frame_crc(data, protection.crc_byte, protection.data_id)
            position = protection.crc_byte
            data = data[:position] + bytes((crc,)) + data[position + 1 :]
        return Frame(message.frame_id, data, message.is_extended_frame)


def raw_values(
    kind: str, channels: Sequence[Channel], values: Mapping[str, float]
) -> dict[str, float]:
    """Raw value of every channel; `RangeError` names kind, channel, limits and value.

    Never clipped: a value that the frame cannot carry is refused.
    """
    raw = {}
    for channel in channels:
        value = values[channel.name]
        if not channel.low <= value <= channel.high:  # refuses what is not a number, too
            raise RangeError(
                f"{kind} {channel.name} is {value}, {channel.signal} carries {channel.low:g} to "
                f"{channel.high:g}; nothing was sent"
            )
        raw[channel.signal] = channel.raw(value)
    return raw


@dataclass(slots=True)
class Readings:
    """Values of one frame in SI units; `faults` give the reasons of absent ones."""

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
        sources = [_Source(message) for message in messages]
        self._sources = {
            (source.layout.message.frame_id, source.layout.message.is_extended_frame): source
            for source in sources
        }
        self._of_group = {
            source.layout.group: source for source in sources if source.layout.group is not None
        }
        # parts of valve commands by joint and signal: those of a pair may be in two messages
        self._parts: dict[str, dict[tuple[str, str], float | None]] = {}
        for message in messages:
            for channel in message.commands:
                self._parts.setdefault(channel.name, {})[message.name, channel.signal] = None

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
                part = min(max(value, channel.least), channel.most)
                value = _directed(layout, channel, part, raw, readings.faults)
            self._parts[channel.name][layout.name, channel.signal] = value
        for name in {channel.name for channel in layout.commands}:
            parts = [part for part in self._parts[name].values() if part is not None]
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
    if code := channel.codes.of(count):
        detail = f"{channel.name}: {channel.signal} is 0x{int(count):X}, which means {code}"
        faults.append(layout.fault(FaultKind.SENSOR, detail, channel.name))
        return None
    if channel.low <= value <= channel.high:
        return value
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
        detail = (
            f"{channel.direction.signal} of {channel.name} is {count}, which is not a direction"
        )
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


class DriverCodec:
    """The driver's end of the bus: readings in, valve commands out.

    Parameters
    ----------
    layout
        What the driver receives and sends, by `load_layout`.
    """

    def __init__(self, layout: Layout):
        self.layout = layout
        self._decoder = Decoder(layout.readings)
        self._encoder = Encoder(layout.commands)
        self.unknown = self._decoder.unknown  # frames by identifiers that are not of the layout
        self.conflicts = self._decoder.conflicts  # ids of two devices that both send a message
        self._valves = frozenset(layout.valves)
        self._neutral = dict.fromkeys(layout.valves, 0.0)
        self._constants = {
            message.name: {
                name: int(value) if value.is_integer() else value
                for name, value in message.constants.items()
            }
            for message in layout.commands
        }

    def decode(self, frame: Frame) -> Readings | None:
        """Read a frame.

        Parameters
        ----------
        frame
            Frame that was received.

        Returns
        -------
        Readings or None
            Readings in SI units, with faults if some are none; None, and counted, if the identifier
            is unknown.
        """
        return self._decoder.decode(frame)

    def command_frames(self, commands: Mapping[str, float], enabled: bool) -> list[Frame]:
        """Encode valve commands.

        Parameters
        ----------
        commands
            Command of each joint, -1 to 1; a joint that is not named is neutral.
        enabled
            Whether the frames enable the valves.

        Returns
        -------
        list of Frame
            One frame for each command message, with counter and checksum.

        Raises
        ------
        RangeError
            If a joint has no valve or a command is not a number from -1 to 1; then no counter moves
            on.
        """
        if unknown := commands.keys() - self._valves:
            raise RangeError(
                f"valve command for {', '.join(sorted(unknown))}, but there are valves for "
                f"{', '.join(self.layout.valves)}; the whole command is refused"
            )
        for joint, command in commands.items():
            if not -1.0 <= command <= 1.0:  # refuses what is not a number, too
                raise RangeError(
                    f"valve command for {joint} is {command}, limits -1 and 1; the whole command "
                    "is refused"
                )
        values = {**self._neutral, **commands}
        frames = []
        for layout in self.layout.commands:
            raw = dict(self._constants[layout.name])
            for channel in layout.commands:
                raw |= channel.counts(values[channel.name])
            if layout.enable:
                raw[layout.enable] = int(enabled)
            frames.append(self._encoder.encode(layout, raw))
        return frames

    def neutral_frames(self) -> list[Frame]:
        return self.command_frames({}, enabled=False)


class MachineCodec:
    """The machine's end of the bus: valve commands in, readings out.

    Parameters
    ----------
    layout
        What the driver at the other end receives and sends, by `load_layout`.
    """

    def __init__(self, layout: Layout):
        self.layout = layout
        self._decoder = Decoder(layout.commands)
        self._encoder = Encoder(layout.readings)
        self._layouts = {message.name: message for message in layout.readings}

    def decode(self, frame: Frame) -> Readings | None:
        """Read a valve frame; None if it is not one."""
        return self._decoder.decode(frame)

    @property
    def cycles(self) -> dict[str, float]:
        """Cycle time of each message to be sent [s]."""
        return {name: layout.cycle for name, layout in self._layouts.items()}

    def reading_frame(
        self,
        message: str,
        positions: Mapping[str, float],
        pressures: Mapping[str, float],
        states: Mapping[str, str],
        accepted: Mapping[str, int] = {},
    ) -> Frame:
        """Encode the readings of one message; signals that nobody maps are 0.

        Parameters
        ----------
        message
            Name of the message in the DBC, which picks what it carries.
        positions, pressures
            Position of each joint [rad, m], and pressure of each chamber and line [Pa].
        states
            State of each device, by its name in the DBC.
        accepted
            Counter of the last accepted frame of each command message.

        Returns
        -------
        Frame
            Frame with counter and checksum.

        Raises
        ------
        RangeError
            If the frame cannot carry a value.
        """
        layout = self._layouts[message]
        raw: dict[str, float] = {signal.name: 0 for signal in layout.message.signals}
        raw |= raw_values("position", layout.positions, positions)
        raw |= raw_values("pressure", layout.pressures, pressures)
        for state in layout.states:
            raw[state.signal] = state.number(states[state.name])
        for echo in layout.echoes:
            raw[echo.signal] = accepted.get(echo.command, echo.nothing)
        return self._encoder.encode(layout, raw)
