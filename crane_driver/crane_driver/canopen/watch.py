"""What one CANopen device says of itself: its state by heartbeats, its emergencies."""

from enum import StrEnum

from canopen.emcy import EmcyError

from crane_driver.can.canopen_settings import EMERGENCY, HEARTBEAT, Device
from crane_driver.can.frame import show_id
from crane_driver.faults import Fault, FaultKind


class NodeState(StrEnum):
    """States of CiA 301, and what is known without a heartbeat."""

    UNHEARD = "not heard yet"
    LOST = "heartbeat lost"
    BOOTED = "booted"
    STOPPED = "stopped"
    OPERATIONAL = "operational"
    PRE_OPERATIONAL = "pre-operational"
    UNKNOWN = "unknown"


STATES = {
    0x00: NodeState.BOOTED,
    0x04: NodeState.STOPPED,
    0x05: NodeState.OPERATIONAL,
    0x7F: NodeState.PRE_OPERATIONAL,
}
"""Bytes of a heartbeat."""


class Watch:
    """One device, judged by the steady clock [s]. A fault is reported once, when it arises."""

    def __init__(self, name: str, device: Device):
        self.name, self.device = name, device
        self.state = NodeState.UNHEARD
        self.heartbeats = self.boots = self.emergencies = 0
        self.longest_gap = 0.0  # s, between heartbeats in operation
        self.active: dict[int, str] = {}  # emergencies since the device's last error reset, by code
        self.news: list[str] = []  # for the log
        self._last = 0.0  # s, steady, of the newest heartbeat

    def heartbeat(self, number: int, steady: float) -> list[Fault]:
        """A heartbeat or boot-up message that came at `steady`."""
        faults = self.check(steady)
        previous, self.state = self.state, STATES.get(number, NodeState.UNKNOWN)
        if previous is NodeState.OPERATIONAL:
            self.longest_gap = max(self.longest_gap, steady - self._last)
        self.heartbeats += 1
        self._last = steady
        if self.state is NodeState.BOOTED:
            self.boots += 1
            self.active.clear()
        if previous is NodeState.OPERATIONAL and self.state is not NodeState.OPERATIONAL:
            if self.state is NodeState.BOOTED:
                detail = "boot-up message in operation; look at its supply and at who resets it"
                faults.append(self._fault(FaultKind.REBOOT, detail))
            else:
                detail = f"state {self.state} (0x{number:02X}), it was operational"
                faults.append(self._fault(FaultKind.NOT_OPERATIONAL, detail))
        return faults

    def check(self, now: float) -> list[Fault]:
        """What shows by no heartbeat coming; to be called in every cycle."""
        silence, limit = now - self._last, self.device.heartbeat_timeout
        if self.state in (NodeState.UNHEARD, NodeState.LOST) or silence <= limit:
            return []
        previous, self.state = self.state, NodeState.LOST
        if previous is not NodeState.OPERATIONAL:
            return []
        detail = f"none for {silence * 1e3:.0f} ms, limit {limit * 1e3:.0f} ms"
        return [self._fault(FaultKind.HEARTBEAT, detail)]

    def emergency(self, error: EmcyError) -> list[Fault]:
        """An emergency message; what it says is a fault only where the mapping declares it."""
        if error.code & 0xFF00 == 0:  # error reset
            self.active.clear()
            return []
        self.emergencies += 1
        text = f"{error}, register 0x{error.register:02X}, data {error.data.hex(' ')}"
        fault = self._fault(FaultKind.EMERGENCY, text, EMERGENCY)
        if error.code not in self.active:
            self.news.append(str(fault))
        self.active[error.code] = text
        return [fault] if self.device.emergency == "fault" else []

    def damaged(self, size: int, expected: int, service: int) -> Fault:
        """A message of the device with the wrong number of bytes."""
        detail = f"{size} bytes, CiA 301 says {expected}"
        return self._fault(FaultKind.WRONG_SIZE, detail, service)

    def _fault(self, kind: FaultKind, detail: str, service: int = HEARTBEAT) -> Fault:
        return Fault(kind, detail, self.name, show_id(service + self.device.id, False))
