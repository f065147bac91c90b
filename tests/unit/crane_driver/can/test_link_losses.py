"""A bus that fails in every way that python-can knows: nothing ends or hides the receiving."""

import queue
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import can
import pytest

from crane_driver import BusSettings, FaultKind, Link, constants
from crane_driver.can import bus as bus_module
from crane_driver.can.bus import BusError, BusState, state_of_error_frame
from crane_driver.can.frame import Frame

PATIENCE = 120.0  # s, in the idle class of the scheduler
DATA = can.Message(arbitration_id=0x120, data=b"12", is_extended_id=False)


class FragileBus(can.BusABC):
    """Gives what the test puts in: messages, and exceptions to raise."""

    channel_info = "fragile"

    def __init__(self, machine: "Machine"):
        super().__init__("fragile")
        self.machine = machine

    def recv(self, timeout: float | None = None) -> can.Message | None:
        try:
            item = self.machine.items.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(item, can.Message):
            return item
        raise item

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Transmit buffer full")

    @property
    def state(self) -> can.BusState:
        return self.machine.state

    def shutdown(self) -> None:
        super().shutdown()
        self.machine.closed += 1


class Machine:
    """What a test does with the bus."""

    def __init__(self) -> None:
        self.items: queue.Queue[can.Message | BaseException] = queue.Queue()
        self.refusals: list[Exception] = []  # of the next openings
        self.opened: list[float] = []
        self.closed = 0
        self.state = can.BusState.ACTIVE

    def open(self, **_: object) -> FragileBus:
        self.opened.append(time.monotonic())
        if self.refusals:
            raise self.refusals.pop(0)
        return FragileBus(self)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    machine = Machine()
    monkeypatch.setattr(can, "Bus", machine.open)
    monkeypatch.setattr(constants, "POLL_PERIOD_S", 0.01)
    monkeypatch.setattr(constants, "FIRST_REOPEN_PAUSE_S", 0.02)
    monkeypatch.setattr(constants, "LONGEST_REOPEN_PAUSE_S", 0.08)
    return machine


@pytest.fixture
def link(machine: Machine) -> Iterator[Link]:
    with Link(BusSettings(interface="fragile", channel="bus0")) as link:
        yield link


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.001)


@pytest.mark.parametrize(
    "error",
    [
        can.CanOperationError("Network is down", 100),
        OSError(19, "No such device"),
        ValueError("a driver's own idea of an error"),
        AssertionError("only requested a single extra field"),
    ],
)
def test_a_lost_bus_is_reported_and_reopened(
    machine: Machine, link: Link, error: Exception
) -> None:
    machine.items.put(DATA)
    machine.items.put(error)
    machine.items.put(DATA)
    until(lambda: link.received == 2)
    assert link.reopened == 1
    assert machine.closed == 1
    (fault,) = link.take_faults()
    assert fault.kind is FaultKind.BUS
    assert f"{type(error).__name__}: {error}; reopened in 0.02 s" == fault.detail
    assert link.state is BusState.ACTIVE


def test_reopening_backs_off_to_a_bound(machine: Machine, link: Link) -> None:
    machine.refusals = [OSError("No such device") for _ in range(5)]
    machine.items.put(can.CanOperationError("gone"))
    until(lambda: link.reopened == 1)
    pauses = [later - earlier for earlier, later in pairwise(machine.opened[1:])]
    for pause, expected in zip(pauses, (0.04, 0.08, 0.08, 0.08, 0.08), strict=True):
        assert expected <= pause
    details = [fault.detail for fault in link.take_faults()]
    assert len(details) == 6
    assert details[1] == (
        "CAN bus fragile bus0 cannot be opened: No such device; reopened in 0.04 s"
    )
    assert details[-1].endswith("reopened in 0.08 s")


def test_the_pause_is_short_again_after_the_bus_has_worked(machine: Machine, link: Link) -> None:
    machine.refusals = [OSError("No such device") for _ in range(3)]
    machine.items.put(can.CanOperationError("gone"))
    machine.items.put(DATA)
    until(lambda: link.received == 1)
    link.take_faults()
    machine.items.put(can.CanOperationError("gone again"))
    until(lambda: link.reopened == 2)
    (fault,) = link.take_faults()
    assert fault.detail.endswith("reopened in 0.02 s")


def test_nothing_is_sent_while_the_bus_is_lost(machine: Machine, link: Link) -> None:
    machine.refusals = [OSError("No such device") for _ in range(1000)]
    machine.items.put(can.CanOperationError("gone"))
    until(lambda: link.state is BusState.LOST)
    with pytest.raises(BusError, match="CAN bus fragile bus0 is lost; the frame was not sent"):
        link.send(Frame(0x110, b""))


def test_closing_does_not_wait_for_the_bus_to_come_back(machine: Machine) -> None:
    link = Link(BusSettings(interface="fragile")).open()
    machine.refusals = [OSError("No such device") for _ in range(1000)]
    machine.items.put(can.CanOperationError("gone"))
    until(lambda: link.state is BusState.LOST)
    link.close()
    assert link.state is BusState.CLOSED


def test_a_frame_that_cannot_be_sent_is_an_error(link: Link) -> None:
    with pytest.raises(BusError, match="fragile bus0: frame was not sent: Transmit buffer full"):
        link.send(Frame(0x110, b""))


def error_frame(kind: int, controller: int = 0) -> can.Message:
    """An error frame as the SocketCAN back end hands it on (linux/can/error.h)."""
    return can.Message(
        arbitration_id=kind,
        data=bytes((0, controller, 0, 0, 0, 0, 0, 0)),
        is_error_frame=True,
        is_extended_id=False,
    )


def test_bus_off_is_found_by_its_error_frame(machine: Machine, link: Link) -> None:
    """The back end of SocketCAN goes on saying ACTIVE."""
    machine.refusals = [OSError("still off") for _ in range(1000)]
    machine.items.put(DATA)
    machine.items.put(error_frame(0x040))
    until(lambda: link.state is not BusState.ACTIVE and link.received == 1)
    assert machine.state is can.BusState.ACTIVE
    fault = link.take_faults()[0]
    assert "CAN bus fragile bus0 is bus-off: check wiring" in fault.detail
    assert link.received == 1, "an error frame is no data"


def test_bus_off_is_found_by_the_state_of_a_back_end_that_knows_it(
    machine: Machine, link: Link
) -> None:
    machine.state = can.BusState.ERROR
    until(lambda: link.state is BusState.BUS_OFF)
    machine.state = can.BusState.ACTIVE
    machine.items.put(DATA)
    until(lambda: link.state is BusState.ACTIVE)
    assert "bus-off" in link.take_faults()[0].detail


@pytest.mark.parametrize(("controller", "state"), [(0x20, "error passive"), (0x04, "error warn")])
def test_a_troubled_controller_is_reported_once(
    machine: Machine, link: Link, controller: int, state: str
) -> None:
    for _ in range(3):
        machine.items.put(error_frame(0x004, controller))
    machine.items.put(DATA)
    until(lambda: link.received == 1)
    (fault,) = link.take_faults()
    assert state in fault.detail
    machine.items.put(error_frame(0x004, 0x40))
    until(lambda: link.state is BusState.ACTIVE)


@pytest.mark.parametrize(
    ("identifier", "controller", "state"),
    [
        (0x040, 0x00, BusState.BUS_OFF),
        (0x100, 0x00, BusState.ACTIVE),  # restarted
        (0x004, 0x10, BusState.PASSIVE),
        (0x004, 0x20, BusState.PASSIVE),
        (0x004, 0x08, BusState.WARNING),
        (0x004, 0x40, BusState.ACTIVE),
        (0x004, 0x01, None),  # an overflow says nothing of the state
        (0x008, 0x30, None),  # data[1] has another meaning in other classes
    ],
)
def test_error_frames_are_read_as_the_kernel_defines_them(
    identifier: int, controller: int, state: BusState | None
) -> None:
    assert state_of_error_frame(identifier, bytes((0, controller))) is state


def test_an_interface_without_carrier_is_bus_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bus_module, "INTERFACES", tmp_path)
    settings = BusSettings(interface="socketcan", channel="can7")
    bus = FragileBus(Machine())
    bus_module.check_state(bus, settings)  # no such folder: not known, not wrong
    (tmp_path / "can7").mkdir()
    carrier = tmp_path / "can7" / "carrier"
    carrier.write_text("1\n")
    bus_module.check_state(bus, settings)
    carrier.write_text("0\n")
    with pytest.raises(BusError, match="can7 is bus-off"):
        bus_module.check_state(bus, settings)


def test_remote_frames_are_counted_not_taken_for_data(machine: Machine, link: Link) -> None:
    machine.items.put(can.Message(arbitration_id=0x120, is_remote_frame=True))
    machine.items.put(DATA)
    until(lambda: link.received == 1)
    assert len(link.take()) == 1
    assert link.ignored == 1


@pytest.mark.parametrize("stamp", [0.0, 12.5, 4e9])
def test_stamps_of_another_clock_are_not_believed(
    machine: Machine, link: Link, stamp: float
) -> None:
    """Some back ends stamp by the clock of their hardware."""
    earliest = time.time_ns()
    machine.items.put(
        can.Message(arbitration_id=1, is_extended_id=False, timestamp=stamp, data=b"")
    )
    until(lambda: link.received == 1)
    (frame,) = link.take()
    assert earliest <= frame.stamp <= time.time_ns()
