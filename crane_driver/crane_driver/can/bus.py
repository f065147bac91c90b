"""CAN buses: the options that name them, opening, and the state they are in."""

import ctypes
import select
import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any

import can
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message, unpack_message
from pydantic import Field

from crane_model.configuration import Schema, WrongYamlError, YamlText, validate
from crane_model.errors import ConfigurationError, CraneError

LARGEST_DATAGRAM_BYTES = 4096  # bytes; a frame of 64 bytes takes less than 300
TIMESPEC = struct.Struct("@ll")  # s, ns
STAMP_BYTES = socket.CMSG_SPACE(TIMESPEC.size)

# linux/filter.h and asm-generic/socket.h: instructions of classic BPF, and what they can load
SO_ATTACH_FILTER = 26
INSTRUCTION = struct.Struct("=HBBI")
LOAD_WORD, LOAD_HALF, IF_EQUAL, RETURN = 0x20, 0x28, 0x15, 0x06
SOURCE_PORT = 0  # offset; the filter of a UDP socket sees datagrams from their UDP header on
PACKET_TYPE, INTERFACE_INDEX = 0xFFFFF004, 0xFFFFF008
LOOPED_BACK, LOOPBACK_INTERFACE = 5, 1
DROP, WHOLE = 0, 0xFFFFFFFF  # bytes that pass

INTERFACES = Path("/sys/class/net")
RECEIVE_BUFFER_BYTES = 1 << 20  # bytes; the default of Linux holds 0.2 s of a busy bus

# linux/can/error.h: classes in the identifier, state of the controller in data[1]
CONTROLLER, BUS_OFF, RESTARTED = 0x004, 0x040, 0x100


class EchoFreeMulticastBus(UdpMulticastBus):
    """An IPv4 multicast bus of Linux on which nobody hears itself.

    python-can sends and receives through one socket, and gives every process its own frames back.
    Here a second socket sends, and a filter in the kernel keeps its datagrams from the socket that
    receives: nobody is woken for them. The frames are those of python-can: its own class may be at
    the other end. If the kernel refuses the filter, echoes come as they do with that class.
    """

    def __init__(
        self, channel: str, port: int = 43113, hop_limit: int = 1, fd: bool = True, **rest: Any
    ):
        """Parameters are those of `can.interfaces.udp_multicast.UdpMulticastBus`."""
        super().__init__(channel, port, hop_limit, fd=fd, **rest)
        self._group = (channel, port)
        self._receiver = socket.socket(fileno=socket.dup(self.fileno()))
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, hop_limit)
        self._sender.bind(("", 0))
        with suppress(OSError):
            _refuse_own(self._receiver, self._sender.getsockname()[1])

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to the group; a datagram is sent at once, so `timeout` [s] has no effect."""
        if msg.is_fd and self.protocol is not can.CanProtocol.CAN_FD:
            raise can.CanOperationError("cannot send a CAN FD frame: CAN FD is disabled")
        try:
            self._sender.sendto(pack_message(msg), self._group)
        except OSError as error:
            raise can.CanOperationError(f"failed to send via socket: {error}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """The next unfiltered frame and False; None after `timeout` [s] or a foreign datagram."""
        if not select.select([self._receiver], [], [], timeout)[0]:
            return None, False
        try:
            data, ancillary, _, _ = self._receiver.recvmsg(
                LARGEST_DATAGRAM_BYTES, STAMP_BYTES, socket.MSG_DONTWAIT
            )
        except BlockingIOError:  # its checksum was wrong
            return None, False
        seconds, nanoseconds = TIMESPEC.unpack(ancillary[0][2])
        try:
            stamp = {"timestamp": seconds + nanoseconds * 1e-9}
            message = unpack_message(data, stamp, check=True)
        except Exception:  # whatever a stranger on this port sends
            return None, False
        if message.is_fd and self.protocol is not can.CanProtocol.CAN_FD:
            return None, False
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._receiver.close()
        self._sender.close()


def _refuse_own(receiver: socket.socket, port: int) -> None:
    """Keep datagrams that this computer sends from `port` out of `receiver`.

    Those of another computer may come from a port of the same number. Multicast datagrams of this
    one are looped back on their way out, or go through the loopback interface.
    """
    program = (
        (LOAD_HALF, 0, 0, SOURCE_PORT),
        (IF_EQUAL, 0, 4, port),
        (LOAD_WORD, 0, 0, PACKET_TYPE),
        (IF_EQUAL, 3, 0, LOOPED_BACK),
        (LOAD_WORD, 0, 0, INTERFACE_INDEX),
        (IF_EQUAL, 1, 0, LOOPBACK_INTERFACE),
        (RETURN, 0, 0, WHOLE),
        (RETURN, 0, 0, DROP),
    )  # each: code, instructions to skip if equal, and if not, operand
    packed = b"".join(INSTRUCTION.pack(*instruction) for instruction in program)
    instructions = ctypes.create_string_buffer(packed, len(packed))
    description = struct.pack("@HP", len(program), ctypes.addressof(instructions))
    receiver.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, description)


Extra = bool | int | float | str

# hop_limit 0: datagrams never leave this machine.
DEFAULTS: dict[str, dict[str, Extra]] = {
    "udp_multicast": {"channel": "239.74.163.2", "hop_limit": 0, "fd": False}
}


class BusError(CraneError):
    """The CAN bus cannot be opened, read or written.

    Examples: no such interface, the interface is down, the controller is bus-off, nobody
    acknowledges and the transmit queue is full.
    """


class BusState(StrEnum):
    """State of the bus. Only a received frame makes it active."""

    CLOSED = "closed"
    LOST = "lost"  # being reopened
    SILENT = "silent"  # open, no frame so far
    ACTIVE = "active"
    WARNING = "error warning"
    PASSIVE = "error passive"
    BUS_OFF = "bus-off"  # being reopened


class BusSettings(Schema):
    """Parameters by which python-can opens a bus.

    Parameters
    ----------
    interface, channel
        Interface of python-can and its channel; None: the default of the interface.
    bitrate
        Bit rate [bit/s]; None: as it is set.
    extra
        Further parameters of the interface, such as a port.

    Examples
    --------
    >>> str(BusSettings(interface="socketcan", channel="can0", bitrate=500_000))
    'socketcan can0'
    """

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


CONTROLLER_STATES = {
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
        return next((state for mask, state in CONTROLLER_STATES.items() if data[1] & mask), None)
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
                duplicate.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


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


def may_leave_computer(settings: BusSettings) -> bool:
    """Return whether frames can leave this computer.

    Only a virtual bus, and udp_multicast with a hop limit of 0, keep them here.
    """
    hops = settings.extra.get("hop_limit", 0)
    return settings.interface != "virtual" and (settings.interface, hops) != ("udp_multicast", 0)


def check_private(settings: BusSettings) -> None:
    """Check that frames cannot leave this computer: on simulated time valves are waited for.

    `ConfigurationError` if they can.
    """
    if not may_leave_computer(settings):
        return
    hops = settings.extra.get("hop_limit", 0)
    limit = f" with hop_limit {hops}" if settings.interface == "udp_multicast" else ""
    raise ConfigurationError(
        f"simulated time: CAN bus {settings}{limit} can leave this computer, and real valves do "
        "not wait; use udp_multicast with hop_limit 0, or run without simulated time"
    )
