"""The mapping file: which signals are joint positions, pressures, valve commands and states."""

import math
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, field_validator, model_validator

from crane_model.configuration import Schema

NMT, EMERGENCY, SDO_RESPONSE, SDO_REQUEST, HEARTBEAT = 0x000, 0x080, 0x580, 0x600, 0x700
"""Identifiers of CiA 301; all but that of NMT are counted up by the id of the node."""

LINES = ("supply", "tank")
"""Pressures that are of no joint; those of a joint's chambers are JOINT.a and JOINT.b."""
# Quantity and size in SI units; units are compared by these, without regard to case.
UNITS = {
    "rad": ("angle", 1.0),
    **dict.fromkeys(("deg", "°", "º", "˚", "degree", "degrees", "grad"), ("angle", math.pi / 180)),
    "mrad": ("angle", 1e-3),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "pa": ("pressure", 1.0),
    "kpa": ("pressure", 1e3),
    "mpa": ("pressure", 1e6),
    "mbar": ("pressure", 1e2),
    "bar": ("pressure", 1e5),
    "psi": ("pressure", 6894.757293168),
    "a": ("current", 1.0),
    "ma": ("current", 1e-3),
    "": ("ratio", 1.0),
    "-": ("ratio", 1.0),
    **dict.fromkeys(("%", "percent", "prozent"), ("ratio", 1e-2)),
}


class Device(Schema):
    """A CANopen device; times in s."""

    id: Annotated[int, Field(ge=1, le=127)]
    heartbeat_timeout: Annotated[float, Field(gt=0)]
    # written to object 1017h before the device is started; without it the device is left as it is
    heartbeat_period: Annotated[float, Field(ge=0.001, le=65.535)] | None = None
    emergency: Literal["report", "fault"] = "report"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.heartbeat_period and self.heartbeat_period >= self.heartbeat_timeout:
            raise ValueError(
                f"heartbeat_period is {self.heartbeat_period:g} s, it must be less than "
                f"heartbeat_timeout, {self.heartbeat_timeout:g} s"
            )
        return self


def identifiers(devices: dict[str, Device]) -> dict[int, str]:
    """The 11-bit identifiers that `devices` take, each with what it is; one id, one node."""
    taken = {NMT: "network management"} if devices else {}
    for name, device in devices.items():
        taken |= {
            HEARTBEAT + device.id: f"heartbeat of {name}",
            EMERGENCY + device.id: f"emergency of {name}",
            SDO_RESPONSE + device.id: f"SDO response of {name}",
            SDO_REQUEST + device.id: f"SDO request to {name}",
        }
    return taken


SignalName = Annotated[str, Field(pattern=r"^\w+\.\w+$")]
"""MESSAGE.SIGNAL"""


class SignalUnit(NamedTuple):
    """Quantity of a unit, and its size in SI units."""

    quantity: str  # angle, length, pressure, current, ratio
    size: float


def spellings(unit: str) -> tuple[str, ...]:
    """A unit as it was read, and in GB2312: "¡ã" is the degree of a Chinese tool."""
    try:
        return unit, unit.encode("cp1252").decode("gb2312")
    except UnicodeError:
        return (unit,)


def unit_of(text: str) -> SignalUnit | None:
    """Quantity and size of a unit in any spelling; None if it is not known."""
    for spelled in spellings(text):
        if found := UNITS.get(spelled.strip().strip("[]()").strip(" .").casefold()):
            return SignalUnit(*found)
    return None


class PositionSignal(Schema):
    """Joint position: sign * (reading - zero)."""

    signal: SignalName
    unit: str
    sign: Literal[-1, 1] = 1
    zero: float = 0.0  # rad or m
    fault: SignalName | None = None


class PressureSignal(Schema):
    """Gauge pressure: reading - zero."""

    signal: SignalName
    unit: str
    zero: float = 0.0  # Pa
    fault: SignalName | None = None


class Direction(Schema):
    """Signal of the direction of a magnitude: values of the DBC's value table, or numbers."""

    signal: SignalName
    positive: str | int
    negative: str | int
    neutral: str | int | None = None


class ValveSignal(Schema):
    """Value sent to the valve: sign * command, command -1 to 1.

    One `signal` with both signs; or a `signal` without sign and its `direction`; or two one-sided
    signals, `positive` and `negative`. `full`: the signal at a command of 1, in `unit`.
    """

    signal: SignalName | None = None
    direction: Direction | None = None
    positive: SignalName | None = None
    negative: SignalName | None = None
    unit: str
    full: Annotated[float, Field(gt=0)] | None = None
    sign: Literal[-1, 1] = 1

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        pair = (self.positive is not None, self.negative is not None)
        if any(pair) == (self.signal is not None) or any(pair) != all(pair):
            raise ValueError(
                "give signal, or both positive and negative (one-sided signals of one valve)"
            )
        if self.direction is None:
            return self
        if self.signal is None:
            raise ValueError("direction belongs to signal; positive and negative need none")
        if self.direction.signal.split(".")[0] != self.signal.split(".")[0]:
            raise ValueError(f"{self.direction.signal} and {self.signal} are not in one message")
        return self


class StateSignal(Schema):
    """State of a device; the healthy values as the DBC's value table names them, or numbers."""

    signal: SignalName
    healthy: Annotated[tuple[str | int, ...], Field(min_length=1)]


class Protection(Schema):
    """Counter and checksum of a message: names of its signals.

    accepted: of a command message, the signal in which the machine gives back the counter of the
    last frame that it accepted.
    """

    counter: str | None = None
    crc: str | None = None
    profile: Literal["autosar_e2e_1", "sae_j1850"] | None = None
    data_id: Annotated[int, Field(ge=0, le=0xFFFF)] | None = None
    accepted: SignalName | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.counter is None and self.crc is None:
            raise ValueError("name the signal of a counter or of a crc, or both")
        if (self.crc is None) != (self.profile is None):
            raise ValueError("crc and profile belong together: give both or neither")
        if (self.profile == "autosar_e2e_1") != (self.data_id is not None):
            raise ValueError("data_id belongs to profile autosar_e2e_1: give both or neither")
        if self.accepted and not self.counter:
            raise ValueError("accepted gives back a counter: name the signal of the counter")
        return self


class Timing(Schema):
    """Limits beyond which the stream of a message is at fault, in cycles of the message."""

    late: Annotated[float, Field(gt=1)]
    missing: Annotated[float, Field(gt=1)]
    lost: Annotated[int, Field(ge=0)]  # frames in a row

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.missing <= self.late:
            raise ValueError(f"missing is {self.missing}, it must be more than late, {self.late}")
        return self


class Mapping(Schema):
    """One machine's mapping of its DBC file.

    codes: whether the greatest raw values of a J1939 message are codes ("not available", "error")
    for which the DBC states no range, or, by "none", measurements.
    """

    positions: Annotated[dict[str, PositionSignal], Field(min_length=1)]
    pressures: dict[str, PressureSignal] = {}
    commands: dict[str, ValveSignal] = {}
    enable: SignalName | tuple[SignalName, ...] = ()  # one a message
    constants: dict[SignalName, float] = {}  # other signals of the command messages, fixed
    states: dict[str, StateSignal] = {}
    protection: dict[str, Protection] = {}
    timing: Timing
    codes: Literal["j1939", "none"] = "j1939"
    canopen: dict[str, Device] = {}

    @field_validator("canopen")
    @classmethod
    def _nodes(cls, value: dict[str, Device]) -> dict[str, Device]:
        owners: dict[int, str] = {}
        for name, device in value.items():
            if (owner := owners.setdefault(device.id, name)) != name:
                raise ValueError(f"{owner} and {name} have the same node id {device.id}")
        return value
