"""Datagrams of the multicast bus: whose are heard, how far they go, and which are not frames."""

import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack

import can
import msgpack
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus

from crane_driver import BusSettings
from crane_driver.can import bus as bus_module
from crane_driver.can.bus import EchoFreeMulticastBus, open_bus

GROUP = "239.74.163.2"
IP_RECVTTL = 12  # linux/in.h
PATIENCE = 120.0  # s, in the idle class of the scheduler
SILENCE = 0.1  # s, in which an echo would have come: it is there when `send` returns


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def bus(port: int, opened: ExitStack) -> can.BusABC:
    bus = open_bus(BusSettings(extra={"port": port}))
    assert isinstance(bus, EchoFreeMulticastBus)
    return opened.enter_context(bus)


@pytest.fixture
def peer(port: int, opened: ExitStack) -> can.BusABC:
    return opened.enter_context(
        can.Bus(interface="udp_multicast", channel=GROUP, port=port, hop_limit=0)
    )


def message(number: int, data: bytes = b"", *, fd: bool = False) -> can.Message:
    return can.Message(arbitration_id=number, data=data, is_extended_id=False, is_fd=fd)


def received(bus: can.BusABC) -> can.Message:
    answer = bus.recv(PATIENCE)
    assert answer is not None
    return answer


def stranger(port: int, datagram: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        sender.sendto(datagram, (GROUP, port))


def test_own_frames_do_not_even_reach_the_process(bus: can.BusABC, peer: can.BusABC) -> None:
    for number in range(5):
        bus.send(message(number))
    assert [received(peer).arbitration_id for _ in range(5)] == [0, 1, 2, 3, 4]
    assert bus.recv(SILENCE) is None


def test_python_can_hears_and_is_heard(bus: can.BusABC, peer: can.BusABC) -> None:
    sent = can.Message(arbitration_id=0x18FF1234, data=b"to peer", channel="abc")
    bus.send(sent)
    assert received(peer).equals(sent, timestamp_delta=None)
    peer.send(sent)
    heard = received(bus)
    assert heard.equals(sent, timestamp_delta=None)
    assert heard.timestamp == pytest.approx(received(peer).timestamp, abs=1.0)


def test_two_buses_of_one_process_hear_each_other(port: int, bus: can.BusABC) -> None:
    with open_bus(BusSettings(extra={"port": port})) as other:
        bus.send(message(1))
        other.send(message(2))
        assert received(other).arbitration_id == 1
        assert received(bus).arbitration_id == 2
        assert bus.recv(SILENCE) is None
        assert other.recv(SILENCE) is None


def test_a_sender_of_another_computer_may_have_the_same_port(
    port: int, bus: can.BusABC, peer: can.BusABC, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if what comes from this computer came from another one."""
    monkeypatch.setattr(bus_module, "LOOPED_BACK", 99)
    monkeypatch.setattr(bus_module, "LOOPBACK_INTERFACE", 999_999)
    with open_bus(BusSettings(extra={"port": port})) as other:
        other.send(message(1))
        assert received(other).arbitration_id == 1


@pytest.mark.parametrize("allowed", [{}, {"hop_limit": 0}])
def test_frames_do_not_leave_this_computer_unless_they_may(
    port: int, opened: ExitStack, allowed: dict[str, bool | int | float | str]
) -> None:
    listener = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    for option in (socket.SO_REUSEADDR, socket.SO_REUSEPORT):
        listener.setsockopt(socket.SOL_SOCKET, option, 1)
    listener.setsockopt(socket.IPPROTO_IP, IP_RECVTTL, 1)
    listener.bind(("", port))
    group = socket.inet_aton(GROUP) + socket.inet_aton("0.0.0.0")
    listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    listener.settimeout(PATIENCE)
    opened.enter_context(open_bus(BusSettings(extra={"port": port, **allowed}))).send(message(1))
    ((_, _, left),) = listener.recvmsg(4096, 100)[1]
    assert struct.unpack("@i", left) == (0,)


def test_frames_may_go_as_far_as_the_hop_limit_says(port: int, opened: ExitStack) -> None:
    bus = opened.enter_context(open_bus(BusSettings(extra={"port": port, "hop_limit": 3})))
    assert isinstance(bus, EchoFreeMulticastBus)
    assert bus._sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 3


def fields(**changes: object) -> bytes:
    frame = {
        "timestamp": 0.0, "arbitration_id": 2, "is_extended_id": False, "is_remote_frame": False,
        "is_error_frame": False, "channel": None, "dlc": 1, "data": b"2", "is_fd": False,
        "bitrate_switch": False, "error_state_indicator": False,
    }  # fmt: skip
    packed: bytes = msgpack.packb(frame | changes)
    return packed


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\xc1 not msgpack",
        msgpack.packb([1, 2, 3]),
        msgpack.packb(7),
        fields()[:-5],
        fields(check=False),
        fields(strange=1),
        fields(dlc=9, data=bytes(9)),
        fields(data="text"),
        fields(arbitration_id=0x800),
        fields(arbitration_id="two"),
        fields(channel="x" * 5000),
        fields(is_fd=True, dlc=64, data=bytes(64)),
    ],
    ids=lambda datagram: datagram[:20].hex(),
)
def test_what_is_not_a_frame_is_passed_over(port: int, bus: can.BusABC, datagram: bytes) -> None:
    stranger(port, datagram)
    stranger(port, fields(arbitration_id=3))
    assert received(bus).arbitration_id == 3


def test_a_frame_of_can_fd_passes_only_where_it_is_allowed(
    port: int, bus: can.BusABC, peer: can.BusABC
) -> None:
    long = message(1, bytes(64), fd=True)
    with pytest.raises(can.CanOperationError, match="CAN FD is disabled"):
        bus.send(long)
    with open_bus(BusSettings(extra={"port": port, "fd": True})) as other:
        other.send(long)
        assert len(received(peer).data) == 64
        peer.send(long)
        assert len(received(other).data) == 64
    assert bus.recv(SILENCE) is None


def test_all_sockets_are_closed(bus: can.BusABC) -> None:
    bus.shutdown()
    bus.shutdown()
    assert bus.fileno() == -1
    with pytest.raises(can.CanOperationError, match="failed to send"):
        bus.send(message(1))


def test_a_group_of_ipv6_is_one_of_python_can(port: int) -> None:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.connect(("ff02::1234", port))
    except OSError:
        pytest.skip("this computer has no route for multicast of IPv6")
    settings = BusSettings(channel=UdpMulticastBus.DEFAULT_GROUP_IPv6, extra={"port": port})
    with open_bus(settings) as bus:
        assert type(bus) is UdpMulticastBus
