"""CAN buses: opened from parameters, and the options that name them."""

import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any

import can
from pydantic import Field

from crane_driver.can.multicast import EchoFreeMulticastBus
from crane_model.configuration import Schema, WrongYamlError, YamlText, validate
from crane_model.errors import ConfigurationError, CraneError

# Opening CAN buses from parameters, and what state they are in.

Extra = bool | int | float | str

# hop_limit 0: datagrams never leave this machine.
DEFAULTS: dict[str, dict[str, Extra]] = {
    "udp_multicast": {"channel": "239.74.163.2", "hop_limit": 0, "fd": False},
}
INTERFACES = Path("/sys/class/net")
RECEIVE_BUFFER = 1 << 20  # bytes; the default of Linux holds 0.2 s of a busy bus


class BusError(CraneError):
    """The CAN bus cannot be opened, read or written.

    Examples: no such interface, the interface is down, the controller is bus-off, nobody
    acknowledges and the transmit queue is full.
    """


class BusState(StrEnum):
    """What is known of the bus. Only a received frame makes it active."""

    CLOSED = "closed"
    LOST = "lost"  # being reopened
    SILENT = "silent"  # open, no frame so far
    ACTIVE = "active"
    WARNING = "error warning"
    PASSIVE = "error passive"
    BUS_OFF = "bus-off"  # being reopened


class BusSettings(Schema):
    """Parameters of python-can; `extra` are further ones of the interface, such as a port."""

    interface: str = "udp_multicast"
    channel: str | None = None
    bitrate: int | None = Field(default=None, gt=0)
    extra: dict[str, Extra] = {}

    def __str__(self) -> str:
        channel = self.channel or DEFAULTS.get(self.interface, {}).get("channel")
        return f"{self.interface}" + (f" {channel}" if channel else "")


def open_bus(settings: BusSettings) -> can.BusABC:
    """Open a bus; `BusError` names interface, channel, reason and remedy."""
    parameters: dict[str, Any] = {**DEFAULTS.get(settings.interface, {}), **settings.extra}
    if settings.channel is not None:
        parameters["channel"] = settings.channel
    if settings.bitrate is not None:
        parameters["bitrate"] = settings.bitrate
    try:
        bus = _open(settings.interface, parameters)
    except Exception as error:  # the back ends of python-can raise whatever their drivers do
        reason = error.__cause__ or error
        raise BusError(
            f"CAN bus {settings} cannot be opened: {reason}{_remedy(settings.interface)}"
        ) from error
    _enlarge_receive_buffer(bus)
    return bus


def _open(interface: str, parameters: dict[str, Any]) -> can.BusABC:
    ipv4 = ":" not in str(parameters.get("channel"))
    if interface == "udp_multicast" and ipv4 and sys.platform == "linux":
        return EchoFreeMulticastBus(**parameters)
    return can.Bus(interface=interface, ignore_config=True, **parameters)


def check_state(bus: can.BusABC, settings: BusSettings) -> None:
    """`BusError` where the bus is known to be off, by its back end or by the operating system.

    The back end of SocketCAN always says ACTIVE; there the carrier of the interface tells.
    """
    if bus.state is can.BusState.ERROR:
        raise BusOffError(settings)
    if settings.interface == "socketcan" and settings.channel:
        carrier = INTERFACES / settings.channel / "carrier"
        with suppress(OSError):  # an interface that is down has no carrier file to read
            if carrier.read_text().strip() == "0":
                raise BusOffError(settings)


class BusOffError(BusError):
    """The controller has taken itself off the bus after too many errors."""

    def __init__(self, settings: BusSettings):
        super().__init__(
            f"CAN bus {settings} is bus-off: check wiring, termination and bit rate; SocketCAN "
            "restarts by itself only where restart-ms is set"
        )


# linux/can/error.h: classes in the identifier, state of the controller in data[1]
CONTROLLER, BUS_OFF, RESTARTED = 0x004, 0x040, 0x100
STATES = {
    0x30: BusState.PASSIVE,  # receiving or transmitting
    0x0C: BusState.WARNING,
    0x40: BusState.ACTIVE,
}


def state_of_error_frame(identifier: int, data: bytes | bytearray) -> BusState | None:
    """State of the bus that an error frame of SocketCAN reports; None if it reports none."""
    if identifier & BUS_OFF:
        return BusState.BUS_OFF
    if identifier & RESTARTED:
        return BusState.ACTIVE
    if identifier & CONTROLLER and len(data) > 1:
        return next((state for mask, state in STATES.items() if data[1] & mask), None)
    return None


def _remedy(interface: str) -> str:
    if interface == "socketcan":
        return "; see `ip link`, and bring the interface up with its bit rate"
    if interface == "udp_multicast":
        return "; multicast needs a route, for example `ip route add 224.0.0.0/4 dev lo`"
    return ""


def _enlarge_receive_buffer(bus: can.BusABC) -> None:
    """Ask for a buffer that outlasts a pause of the receiving thread; the system may give less."""
    with suppress(NotImplementedError, OSError):
        descriptor = bus.fileno()
        if descriptor >= 0:
            with socket.socket(fileno=socket.dup(descriptor)) as duplicate:
                duplicate.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)


# CAN bus settings from what a command line or a ROS parameter can carry.


def bus_settings(
    interface: str, channel: str = "", bitrate: int = 0, options: Sequence[str] = ()
) -> BusSettings:
    """Settings of a bus; an empty channel and bit rate 0 leave them to python-can.

    options: further ones of the interface as KEY=VALUE, for example port=43113.
    `ConfigurationError` names the option that is wrong.
    """
    extra: dict[str, Extra] = {}
    for option in options:
        key, equals, text = option.partition("=")
        if not (key.isidentifier() and equals and isinstance(value := _value(text), Extra)):
            raise ConfigurationError(
                f"bus option '{option}': write KEY=VALUE, for example port=43113"
            )
        extra[key] = value
    given = {"interface": interface, "channel": channel or None, "bitrate": bitrate or None}
    return validate({**given, "extra": extra}, BusSettings, "bus")


def _value(text: str) -> object:
    try:
        return YamlText(text).content
    except WrongYamlError:
        return None
