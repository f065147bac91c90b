"""Mapping and DBC brought together, ready for coding and decoding frames."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from cantools.database.can import Message

from crane_driver.can.frame import show_id
from crane_driver.can.mapping import Device, Timing
from crane_driver.faults import Fault, FaultKind

LARGEST_MEASUREMENT = {
    2: 2,
    4: 14,
    10: 0x3FA,
    **{length: (0xFB << (length - 8)) - 1 for length in (8, 12, 16, 20, 24, 28, 32)},
}
"""Largest raw value that is not a code, by the length in bits. Source: SAE J1939-71, transmitted
signal ranges; states of two and four bits keep their error, the value below, which nobody takes for
a measurement."""


class Code(StrEnum):
    """Meaning of a raw value of J1939 that is not a measurement."""

    NOT_AVAILABLE = "not available"
    ERROR = "error"
    RESERVED = "reserved"


CODES = {
    0xFF: Code.NOT_AVAILABLE,
    0xFE: Code.ERROR,
    **dict.fromkeys(range(0xFB, 0xFE), Code.RESERVED),
}


@dataclass(frozen=True, slots=True)
class Codes:
    """Raw values of a signal that are not measurements.

    `length`: its bits, if the greatest values are codes of J1939; 0 if they are not. `named`: those
    that the value table of the DBC names as such.
    """

    length: int = 0
    named: Mapping[int, Code] = field(default_factory=dict)

    def of(self, raw: float) -> Code | None:
        """The code that a raw value is; None if it is a measurement."""
        if (code := self.named.get(raw)) is not None:  # type: ignore[call-overload]
            return code
        length = self.length
        if not length or raw <= LARGEST_MEASUREMENT[length]:
            return None
        if length <= 4:
            return Code.NOT_AVAILABLE
        return CODES[int(raw) >> (length - 8) if length != 10 else int(raw) & 0xFF]


MEASUREMENTS = Codes()


@dataclass(frozen=True, slots=True)
class Channel:
    """One mapped signal: SI value = gain * raw value + offset, valid from low to high (SI)."""

    name: str  # joint, JOINT.a, JOINT.b, supply, tank
    signal: str
    gain: float
    offset: float
    low: float
    high: float
    fault: str | None = None  # signal that is not 0 where the reading is no measurement
    is_float: bool = False
    codes: Codes = MEASUREMENTS

    def raw(self, value: float) -> float:
        raw = (value - self.offset) / self.gain
        return raw if self.is_float else round(raw)


@dataclass(frozen=True, slots=True)
class ValveDirection:
    """Signal that says which way a magnitude opens the valve, and its values for a command."""

    signal: str
    positive: int
    negative: int
    neutral: int | None

    def sign(self, value: int) -> int | None:
        """Sign of the command; None if the value says neither a way nor neutral."""
        signs = {self.neutral: 0, self.negative: -1, self.positive: 1}
        return signs.get(value)


@dataclass(frozen=True, slots=True)
class ValveChannel(Channel):
    """A signal of a valve command: from `least` to `most` of -1 to 1.

    The command of a valve is the sum of its channels: of one with both signs, or of one a side.
    With a `direction` the signal carries the magnitude.
    """

    least: float = -1.0
    most: float = 1.0
    direction: ValveDirection | None = None

    def counts(self, command: float) -> dict[str, float]:
        """Raw values of its signals for a command, -1 to 1."""
        if self.direction is None:
            return {self.signal: self.raw(min(max(command, self.least), self.most))}
        count = self.raw(abs(command))
        way = self.direction.negative if command < 0.0 else self.direction.positive
        if count == self.raw(0.0) and self.direction.neutral is not None:
            way = self.direction.neutral
        return {self.signal: count, self.direction.signal: way}


@dataclass(frozen=True, slots=True)
class DeviceState:
    """One mapped state of a device."""

    name: str
    signal: str
    labels: dict[int, str]  # the DBC's value table
    healthy: frozenset[int]

    def label(self, value: int) -> str:
        return self.labels.get(value, str(value))

    def number(self, label: str) -> int:
        numbers = {name: value for value, name in self.labels.items()}
        return numbers[label] if label in numbers else int(label)


@dataclass(frozen=True, slots=True)
class Echo:
    """A signal that gives back the counter of the last accepted frame of a command message."""

    command: str  # message
    signal: str
    nothing: int  # its value before the first frame: the greatest


@dataclass(frozen=True, slots=True)
class Protected:
    """Counter and checksum of a message; None where it has none."""

    counter: str | None
    counter_first: int
    counter_count: int  # values that the counter takes
    crc: str | None
    crc_byte: int
    data_id: int | None


UNPROTECTED = Protected(None, 0, 0, None, 0, None)


@dataclass(frozen=True)
class MessageLayout:
    """One message of the bus that the mapping uses."""

    message: Message
    cycle: float  # s
    positions: tuple[Channel, ...] = ()
    pressures: tuple[Channel, ...] = ()
    commands: tuple[ValveChannel, ...] = ()
    states: tuple[DeviceState, ...] = ()
    echoes: tuple[Echo, ...] = ()
    enable: str | None = None
    constants: dict[str, float] = field(default_factory=dict)  # raw values, all signals to be sent
    protection: Protected = UNPROTECTED
    group: int | None = None  # of J1939, if frames of it from any source address are this message

    @property
    def name(self) -> str:
        return self.message.name

    @property
    def id(self) -> str:
        return show_id(self.message.frame_id, self.message.is_extended_frame)

    def fault(self, kind: FaultKind, detail: str, reading: str = "") -> Fault:
        """A fault of this message, or of one of its readings."""
        return Fault(kind, detail, self.name, self.id, self._measures(), reading)

    def _measures(self) -> str:
        joints = [channel.name for channel in self.positions]
        pressures = dict.fromkeys(channel.name.partition(".")[0] for channel in self.pressures)
        parts = (
            f"encoder{'s' * (len(joints) > 1)} of {', '.join(joints)}" if joints else "",
            f"pressures of {', '.join(pressures)}" if pressures else "",
        )
        return " and ".join(filter(None, parts))


@dataclass(frozen=True)
class Layout:
    """Messages that the driver receives (`readings`) and sends (`commands`)."""

    readings: tuple[MessageLayout, ...]
    commands: tuple[MessageLayout, ...]
    timing: Timing
    devices: dict[str, Device] = field(default_factory=dict)  # CANopen, by name
    codes: bool = True  # codes of J1939 are not taken for readings

    @property
    def positions(self) -> tuple[str, ...]:
        return _names(message.positions for message in self.readings)

    @property
    def pressures(self) -> tuple[str, ...]:
        """Pressures that are read: JOINT.a, JOINT.b, supply, tank."""
        return _names(message.pressures for message in self.readings)

    @property
    def valves(self) -> tuple[str, ...]:
        return _names(message.commands for message in self.commands)

    @property
    def frames_of_cycle(self) -> frozenset[int]:
        """Most frequent frames with positions and pressures; none if an address is unknown."""
        measuring = [message for message in self.readings if message.positions or message.pressures]
        shortest = min(message.cycle for message in measuring)
        often = [message for message in measuring if message.cycle == shortest]
        if any(message.group is not None for message in often):
            return frozenset()
        return frozenset(message.message.frame_id for message in often)

    def resolution(self, name: str) -> float:
        """One raw step of a position or pressure [SI]."""
        channels = [
            channel
            for message in self.readings
            for channel in (*message.positions, *message.pressures)
        ]
        return abs(next(channel.gain for channel in channels if channel.name == name))


def _names(groups: Iterable[tuple[Channel, ...]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(channel.name for group in groups for channel in group))
