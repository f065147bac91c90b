"""Command frames that do not get through are told by the counters that the machine gives back."""

import pytest

from crane_driver import DriverCodec, Fault, FaultKind, MachineCodec
from crane_driver.can.health import Acceptance
from crane_driver.can.layout import Layout

CYCLE, TIMEOUT = 0.005, 0.1  # s


class Bus:
    """Valve frames every cycle, the status of the valves every second one."""

    def __init__(self, layout: Layout):
        self.driver, self.machine = DriverCodec(layout), MachineCodec(layout)
        self.acceptance = Acceptance(layout, TIMEOUT)
        self.accepted: dict[str, int] = {}
        self.now = 0.0

    def run(self, cycles: int, heard: bool = True, sent: bool = True) -> list[Fault]:
        faults = []
        for cycle in range(cycles):
            self.now += CYCLE
            for frame in self.driver.command_frames({}, enabled=True) if sent else []:
                self.acceptance.sent(frame, self.now)
                readings = self.machine.decode(frame)
                assert readings
                assert readings.counter is not None
                if heard:
                    self.accepted[readings.message] = readings.counter
            if cycle % 2:
                faults += self.status()
        return faults

    def status(self) -> list[Fault]:
        state = {"valve_unit": "Enabled"}
        frame = self.machine.reading_frame("ValveStatus", {}, {}, state, accepted=self.accepted)
        readings = self.driver.decode(frame._replace(steady=self.now))
        assert readings
        return self.acceptance.observe(readings)


@pytest.fixture
def bus(crane: Layout) -> Bus:
    return Bus(crane)


def test_commands_that_are_accepted_are_no_fault(bus: Bus) -> None:
    assert bus.run(200) == []
    assert bus.accepted == {"ValveCommand": 199 % 15}


@pytest.mark.parametrize("before", [0, 3, 100])
def test_commands_that_are_not_accepted_are_a_fault_that_goes_on(bus: Bus, before: int) -> None:
    bus.run(before)
    faults = bus.run(100, heard=False)
    assert {fault.kind for fault in faults} == {FaultKind.NOT_ACCEPTED}
    assert 3 <= len(faults) <= 5
    assert "ValveStatus (140): not accepted: ValveCommand has been sent for 1" in str(faults[0])
    assert bus.run(10) == []


def test_silence_of_the_driver_is_no_fault(bus: Bus) -> None:
    bus.run(10)
    assert bus.run(100, sent=False) == []
    assert bus.run(100) == []


def test_a_whole_round_of_the_counter_between_two_echoes_is_no_fault(bus: Bus) -> None:
    for _ in range(50):
        for _ in range(15):
            bus.run(1)
        assert bus.status() == []


def test_a_pause_of_the_status_is_no_fault_of_the_commands(bus: Bus) -> None:
    bus.run(10)
    for _ in range(60):
        bus.run(1)  # alone, without a status
    assert bus.status() == []
