"""Injected faults of the stream: each is named once, and nothing else is."""

from collections.abc import Iterator

import pytest

from crane_driver import DriverCodec, Fault, FaultKind, MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.health import Monitor
from crane_driver.can.layout import Layout
from crane_driver.faults import UNUSABLE

START = 100.0  # s, steady
CYCLE = 0.005


class Bus:
    """The readings of a crane, cycle by cycle, into a monitor; a test decides what gets lost."""

    def __init__(self, layout: Layout):
        self.machine, self.driver = MachineCodec(layout), DriverCodec(layout)
        self.monitor = Monitor(layout.readings, layout.timing, START)
        self.positions = dict.fromkeys(layout.positions, 0.0)
        self.pressures = dict.fromkeys(layout.pressures, 1e6)
        self.messages = list(self.machine.cycles)

    def frame(self, message: str, now: float) -> Frame:
        states = {"valve_unit": "Neutral"}
        frame = self.machine.reading_frame(message, self.positions, self.pressures, states)
        return frame._replace(steady=now)

    def receive(self, frame: Frame) -> list[Fault]:
        readings = self.driver.decode(frame)
        assert readings
        return self.monitor.observe(readings)

    def cycle(self, now: float, absent: str = "") -> list[Fault]:
        faults = []
        for message in self.messages:
            if message != absent:
                faults += self.receive(self.frame(message, now))
        return faults + self.monitor.check(now)


@pytest.fixture
def bus(crane: Layout) -> Bus:
    return Bus(crane)


def times(count: int, start: float = START) -> Iterator[float]:
    return (start + CYCLE * number for number in range(1, count + 1))


def kinds(faults: list[Fault]) -> list[tuple[FaultKind, str]]:
    return [(fault.kind, fault.source) for fault in faults]


def test_a_sound_stream_has_no_fault(bus: Bus) -> None:
    assert not bus.monitor.complete
    assert [fault for now in times(50) for fault in bus.cycle(now)] == []
    assert bus.monitor.complete
    stream = bus.monitor.streams["EncoderBase"]
    assert (stream.received, stream.lost, stream.refused) == (50, 0, 0)
    assert stream.longest_gap == pytest.approx(CYCLE)


def test_jitter_of_one_cycle_is_no_fault(bus: Bus) -> None:
    for number, now in enumerate(times(50)):
        assert bus.cycle(now + (CYCLE * 0.9 if number % 3 else 0.0)) == []


def test_a_message_that_stops_is_late_then_missing_each_once(bus: Bus) -> None:
    faults = [bus.cycle(now) for now in times(10)][-1]
    assert faults == []
    found = [
        (fault.kind, fault.source, round((now - START - 10 * CYCLE) / CYCLE))
        for now in times(40, START + 10 * CYCLE)
        for fault in bus.cycle(now, absent="EncoderBoom")
    ]
    assert found == [
        (FaultKind.LATE, "EncoderBoom", 11),
        (FaultKind.MISSING, "EncoderBoom", 21),
    ]
    assert not bus.monitor.complete
    assert bus.cycle(START + 60 * CYCLE) == [], "its counter may have moved on meanwhile"
    assert bus.monitor.complete


def test_a_gap_between_two_looks_is_late(bus: Bus) -> None:
    """The frames stood in a queue: no look at the clock saw the gap, their stamps show it."""
    bus.cycle(START + CYCLE)
    faults = bus.receive(bus.frame("PressureBooms", START + CYCLE + 0.06))
    assert kinds(faults) == [(FaultKind.LATE, "PressureBooms")]
    assert "60 ms since the last frame, cycle 5 ms" in faults[0].detail


def test_a_message_that_never_comes_is_missing(bus: Bus) -> None:
    faults = bus.monitor.check(START + 1.0)
    assert {fault.source for fault in faults} == set(bus.messages)
    assert {fault.kind for fault in faults} == {FaultKind.MISSING}
    assert "not one yet" in faults[0].detail
    assert bus.monitor.check(START + 2.0) == []


def test_a_repeated_frame_is_named_and_does_not_count_as_fresh(bus: Bus) -> None:
    bus.cycle(START + CYCLE)
    stale = bus.frame("EncoderBase", START)
    found = [
        (fault.kind, fault.kind in UNUSABLE)
        for now in times(20)
        for fault in [*bus.receive(stale._replace(steady=now)), *bus.monitor.check(now)]
        if fault.source == "EncoderBase"
    ]
    repeated = (FaultKind.REPEATED, True)
    assert found.count(repeated) == 19  # all but the first
    assert [one for one in found if one != repeated] == [(FaultKind.LATE, False)]
    assert bus.monitor.streams["EncoderBase"].refused == 19


@pytest.mark.parametrize(("lost", "faulty"), [(1, False), (2, False), (3, True), (8, True)])
def test_lost_frames_are_counted_and_too_many_are_a_fault(
    bus: Bus, lost: int, faulty: bool
) -> None:
    bus.cycle(START + CYCLE)
    for _ in range(lost):
        bus.frame("EncoderBase", 0.0)
    faults = bus.receive(bus.frame("EncoderBase", START + CYCLE * (lost + 2)))
    assert kinds(faults) == ([(FaultKind.SEQUENCE, "EncoderBase")] if faulty else [])
    assert bus.monitor.streams["EncoderBase"].lost == lost


def test_a_counter_that_does_not_exist_is_a_fault(bus: Bus) -> None:
    readings = bus.driver.decode(bus.frame("EncoderBase", START))
    assert readings
    readings.counter = 15
    faults = bus.monitor.observe(readings)
    assert [fault.detail for fault in faults] == ["counter 15, it runs from 0 to 14"]


@pytest.mark.parametrize(
    ("damage", "kind"),
    [
        (lambda data: data[:7], FaultKind.WRONG_SIZE),
        (lambda data: data[:7] + bytes((data[7] ^ 1,)), FaultKind.CHECKSUM),
    ],
)
def test_damaged_frames_do_not_keep_a_message_alive(bus: Bus, damage, kind: FaultKind) -> None:
    bus.cycle(START + CYCLE)
    found: list[Fault] = []
    for now in times(12, START + CYCLE):
        frame = bus.frame("EncoderBase", now)
        found += bus.receive(frame._replace(data=damage(frame.data)))
    found += bus.monitor.check(START + 13 * CYCLE)
    assert [fault.kind for fault in found].count(kind) == 12
    assert (FaultKind.LATE, "EncoderBase") in kinds(found)


def test_two_senders_of_one_message_are_found_by_their_counters(bus: Bus, crane: Layout) -> None:
    other = Bus(crane)
    for _ in range(7):
        other.frame("EncoderBase", 0.0)
    found = []
    for now in times(3):
        found += bus.receive(bus.frame("EncoderBase", now))
        found += bus.receive(other.frame("EncoderBase", now))
    assert kinds(found).count((FaultKind.SEQUENCE, "EncoderBase")) == 5


def test_a_state_that_is_not_healthy_is_a_fault(bus: Bus) -> None:
    states = {"valve_unit": "CommandTimeout"}
    frame = bus.machine.reading_frame("ValveStatus", {}, {}, states)._replace(steady=START)
    faults = bus.receive(frame)
    assert [str(fault) for fault in faults] == [
        "ValveStatus (140): state: valve_unit is CommandTimeout"
    ]
