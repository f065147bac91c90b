"""One set of tests for every kind of bus that a test machine has; then what each is known for."""

import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import can
import pytest

from crane_driver import BusSettings, FaultKind, Link
from crane_driver.can.bus import BusError, BusState, open_bus
from crane_driver.can.frame import Frame

PATIENCE = 120.0  # s, in the idle class of the scheduler


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition; fail where it does not come true."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


@pytest.fixture(params=["virtual", "udp_multicast"])
def settings(request: pytest.FixtureRequest) -> BusSettings:
    if request.param == "virtual":
        return BusSettings(interface="virtual", channel=f"test-{random.random()}")
    return BusSettings(interface="udp_multicast", extra={"port": free_port()})


@pytest.fixture
def pair(settings: BusSettings) -> Iterator[tuple[Link, Link]]:
    with Link(settings) as one, Link(settings) as other:
        yield one, other


def receive(link: Link, count: int) -> list[Frame]:
    frames: list[Frame] = []

    def enough() -> bool:
        frames.extend(link.take())
        return len(frames) >= count

    until(enough)
    return frames


def test_frames_arrive_whole_and_in_order(pair: tuple[Link, Link]) -> None:
    sent = [Frame(0x100 + n % 0x700, bytes([n % 256] * (n % 9)), n % 3 == 0) for n in range(200)]
    for frame in sent:
        pair[0].send(frame)
    received = receive(pair[1], len(sent))
    assert [one[:3] for one in received] == [one[:3] for one in sent]


def test_frames_are_stamped_when_they_come_not_when_they_are_taken(
    pair: tuple[Link, Link],
) -> None:
    wall, steady = time.time_ns(), time.monotonic()
    pair[0].send(Frame(1, b""))
    until(lambda: pair[1].received == 1)
    latest_wall, latest_steady = time.time_ns(), time.monotonic()
    (frame,) = pair[1].take()
    assert wall - 10**6 <= frame.stamp <= latest_wall
    assert steady - 1e-3 <= frame.steady <= latest_steady
    pair[0].send(Frame(2, b""))
    (later,) = receive(pair[1], 1)
    assert later.stamp > frame.stamp
    assert later.steady > frame.steady


def test_own_frames_do_not_come_back(pair: tuple[Link, Link]) -> None:
    one, other = pair
    for _ in range(5):
        one.send(Frame(0x110, b"mine"))
    other.send(Frame(0x110, b"another"))  # of the same identifier
    assert [frame.data for frame in receive(one, 1)] == [b"another"]
    assert len(receive(other, 5)) == 5
    assert one.received == 1


def test_the_state_is_active_only_once_a_frame_has_come(
    settings: BusSettings, pair: tuple[Link, Link]
) -> None:
    one, other = pair
    assert (one.state, other.state) == (BusState.SILENT, BusState.SILENT)
    one.send(Frame(1, b""))
    receive(other, 1)
    assert (one.state, other.state) == (BusState.SILENT, BusState.ACTIVE)
    one.close()
    assert one.state is BusState.CLOSED
    with pytest.raises(BusError, match=f"CAN bus {settings} is closed; the frame was not sent"):
        one.send(Frame(1, b""))


def test_the_last_frame_of_a_cycle_wakes_the_taker_at_once(
    settings: BusSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crane_driver.constants.TRAIN_END_S", PATIENCE)
    monkeypatch.setattr("crane_driver.constants.LONGEST_TRAIN_S", 2 * PATIENCE)
    woken: list[int] = []
    with (
        Link(settings) as sender,
        Link(
            settings, lambda: woken.append(receiver.received), cycle=frozenset({1, 2, 3})
        ) as receiver,
    ):
        for number in (3, 1, 7, 2, 1, 1, 2, 3):
            sender.send(Frame(number, b""))
        until(lambda: receiver.received == 8)
        until(lambda: len(woken) == 2)
        assert woken == [4, 8]


def test_a_flood_is_taken_in_parts_and_the_taker_is_woken_for_the_rest(
    settings: BusSettings,
) -> None:
    woken = threading.Event()
    with Link(settings) as sender, Link(settings, woken.set) as receiver:
        for number in range(10):
            sender.send(Frame(number, b""))
        until(lambda: receiver.received == 10)
        taken = []
        for count in (4, 4, 2):
            until(woken.is_set)
            woken.clear()
            frames = receiver.take(4)
            assert len(frames) == count
            taken += [frame.id for frame in frames]
        assert taken == list(range(10))
        assert not receiver.take(4)


def test_a_full_queue_drops_the_oldest_and_counts(settings: BusSettings) -> None:
    with Link(settings) as sender, Link(settings, capacity=8) as receiver:
        for batch in range(2):
            for n in range(20):
                sender.send(Frame(n, b""))
            until(lambda count=20 * (batch + 1): receiver.received == count)  # type: ignore[misc]
            assert [frame.id for frame in receiver.take()] == list(range(12, 20))
            assert receiver.dropped == 12 * (batch + 1)
            (fault,) = receiver.take_faults()
            assert (fault.kind, fault.detail) == (
                FaultKind.OVERFLOW,
                "8 frames wait; the oldest are dropped",
            )


def test_all_is_heard_until_frames_wait_for_the_taker(settings: BusSettings) -> None:
    with Link(settings) as sender, Link(settings) as receiver:
        assert receiver.heard(1.0) == 1.0
        for number in range(3):
            sender.send(Frame(number, b""))
        until(lambda: receiver.received == 3)
        now = time.monotonic()
        heard = receiver.heard(now)
        assert heard < now
        assert heard == receiver.take(1)[0].steady
        assert receiver.heard(now) == receiver.take()[0].steady
        assert receiver.heard(now) == now


def test_all_is_heard_until_frames_wait_in_the_operating_system() -> None:
    """The receiving thread is held up: there are frames, but it does not come for them."""
    held, free = threading.Event(), threading.Event()

    def hold() -> None:
        held.set()
        free.wait(PATIENCE)

    settings = BusSettings(extra={"port": free_port()})
    with Link(settings) as sender, Link(settings, hold) as receiver:
        sender.send(Frame(1, b""))
        until(held.is_set)
        (first,) = receiver.take()
        now = time.monotonic()
        assert receiver.heard(now) == now
        sender.send(Frame(2, b""))
        until(lambda: receiver.heard(time.monotonic()) == first.steady)
        free.set()
        until(lambda: receiver.received == 2)
        receiver.take()
        now = time.monotonic()
        assert receiver.heard(now) == now


def test_whoever_takes_frames_is_woken(settings: BusSettings) -> None:
    woken = threading.Event()
    with Link(settings) as sender, Link(settings, woken.set):
        assert not woken.is_set()
        sender.send(Frame(1, b""))
        assert woken.wait(PATIENCE)


def test_a_taker_that_cannot_be_woken_does_not_stop_the_link(settings: BusSettings) -> None:
    def gone() -> None:
        raise RuntimeError("the guard condition is destroyed")

    details: list[str] = []

    def told(count: int) -> bool:
        details.extend(fault.detail for fault in receiver.take_faults())
        return len(details) == count

    with Link(settings) as sender, Link(settings, gone) as receiver:
        for number in (1, 2):
            sender.send(Frame(number, b""))
            assert len(receive(receiver, 1)) == 1
            until(lambda count=number: told(count))
        assert set(details) == {"nobody to wake up: RuntimeError: the guard condition is destroyed"}
        assert receiver.state is BusState.ACTIVE


def test_a_link_can_be_opened_again_but_not_twice(settings: BusSettings) -> None:
    link = Link(settings)
    for _ in range(2):
        with link, pytest.raises(BusError, match="is open already"):
            link.open()
        link.close()  # a second time


def test_frames_pass_between_processes_of_this_machine() -> None:
    settings = BusSettings(interface="udp_multicast", extra={"port": free_port()})
    program = (
        "import sys, time\n"
        "from crane_driver.can.bus import BusSettings\n"
        "from crane_driver.can.frame import Frame\n"
        "from crane_driver.can.link import Link\n"
        "with Link(BusSettings.model_validate_json(sys.argv[1])) as link:\n"
        "    while not (frames := link.take()):\n"
        "        time.sleep(0.001)\n"
        "    for frame in frames:\n"
        "        link.send(frame._replace(id=frame.id + 1))\n"
        "    sys.stdin.read()\n"
    )
    with Link(settings) as link:
        process = subprocess.Popen(
            [sys.executable, "-c", program, settings.model_dump_json()],
            stdin=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        try:
            answers: list[Frame] = []

            def answered() -> bool:  # the other process listens from some moment on
                link.send(Frame(0x110, b"there"))
                time.sleep(0.02)
                answers.extend(link.take())
                return bool(answers)

            until(answered)
            assert answers[0][:2] == (0x111, b"there")
        finally:
            assert process.stdin
            process.stdin.close()
            process.wait(PATIENCE)


def test_a_frame_that_is_too_long_is_not_sent(pair: tuple[Link, Link]) -> None:
    with pytest.raises(BusError, match="frame was not sent"):
        pair[0].send(Frame(1, bytes(9)))


def test_the_embedded_bus_never_leaves_this_machine() -> None:
    bus = open_bus(BusSettings(extra={"port": free_port()}))
    try:
        assert isinstance(bus, can.interfaces.udp_multicast.UdpMulticastBus)
        with socket.socket(fileno=os.dup(bus.fileno())) as duplicate:
            hops = duplicate.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL)
        assert hops == 0
    finally:
        bus.shutdown()


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (BusSettings(interface="carrier_pigeon"), "CAN interface 'carrier_pigeon' not supported"),
        (BusSettings(interface="socketcan", channel="nocan0"), "see `ip link`"),
        (BusSettings(channel="10.0.0.1"), "multicast needs a route"),
        (BusSettings(extra={"receive_own_messages": True}), "receiving own messages is not yet"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_named(settings: BusSettings, reason: str) -> None:
    with pytest.raises(BusError, match=f"CAN bus {settings.interface}.*{reason}"):
        Link(settings).open()
