"""CANopen devices on the driver's bus: started, and watched from then on.

Frames come from and go to whoever owns the bus, so that it has one reader.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from enum import StrEnum

import canopen
from canopen.emcy import EmcyError
from canopen.sdo.constants import REQUEST_DOWNLOAD, RESPONSE_DOWNLOAD

from crane_driver import constants
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.mapping import EMERGENCY, HEARTBEAT, SDO_RESPONSE, Device
from crane_driver.faults import Fault, FaultKind

MESSAGE_BYTES = {HEARTBEAT: 1, EMERGENCY: 8, SDO_RESPONSE: 8}  # bytes
PRODUCER_HEARTBEAT_TIME = 0x1017  # object: ms, two bytes
TWO_BYTES = 0x0B  # expedited transfer whose size is indicated as two bytes
CONFIRMED = struct.pack("<BH", RESPONSE_DOWNLOAD, PRODUCER_HEARTBEAT_TIME)


class NodeState(StrEnum):
    """States of CiA 301, and what is known without a heartbeat."""

    UNHEARD = "not heard yet"
    LOST = "heartbeat lost"
    BOOTED = "booted"
    STOPPED = "stopped"
    OPERATIONAL = "operational"
    PRE_OPERATIONAL = "pre-operational"
    UNKNOWN = "unknown"


HEARTBEAT_STATES = {
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
        self.log: list[str] = []  # for the log
        self._last = 0.0  # s, steady, of the newest heartbeat

    def heartbeat(self, number: int, steady: float) -> list[Fault]:
        faults = self.check(steady)
        previous, self.state = self.state, HEARTBEAT_STATES.get(number, NodeState.UNKNOWN)
        if previous is NodeState.OPERATIONAL:
            self.longest_gap = max(self.longest_gap, steady - self._last)
        self.heartbeats += 1
        self._last = steady
        if self.state is NodeState.BOOTED:
            self.boots += 1
            self.active.clear()
        if previous is NodeState.OPERATIONAL and self.state is not NodeState.OPERATIONAL:
            if self.state is NodeState.BOOTED:
                detail = "boot-up message in operation; check its supply, and what resets it"
                faults.append(self._fault(FaultKind.REBOOT, detail))
            else:
                detail = f"state {self.state} (0x{number:02X}), it was operational"
                faults.append(self._fault(FaultKind.NOT_OPERATIONAL, detail))
        return faults

    def check(self, now: float) -> list[Fault]:
        """Check for missing heartbeats; call it in every cycle."""
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
            self.log.append(str(fault))
        self.active[error.code] = text
        return [fault] if self.device.emergency == "fault" else []

    def damaged(self, size: int, expected: int, service: int) -> Fault:
        detail = f"{size} bytes, CiA 301 says {expected}"
        return self._fault(FaultKind.WRONG_SIZE, detail, service)

    def _fault(self, kind: FaultKind, detail: str, service: int = HEARTBEAT) -> Fault:
        return Fault(kind, detail, self.name, show_id(service + self.device.id, False))


class Network(canopen.Network):
    """A network without a bus: it is fed by `notify`, and what it sends is put into `outbox`."""

    def __init__(self) -> None:
        super().__init__()
        self.outbox: list[Frame] = []

    def send_message(self, can_id: int, data: Sequence[int], remote: bool = False) -> None:
        self.outbox.append(Frame(can_id, bytes(data)))


class Node:
    """One device: what it says, and how far it is started."""

    def __init__(self, name: str, device: Device, network: Network):
        self.watch = Watch(name, device)
        self.problem = ""  # why the last attempt to start it failed
        self._remote = network.add_node(device.id)
        self._remote.nmt.add_heartbeat_callback(self._heartbeat)
        self._remote.emcy.add_callback(self._emergency)
        self._faults: list[Fault] = []
        self._steady = 0.0
        self._attempted = -math.inf
        self._asked = self._configured = False  # for the heartbeat period

    def observe(self, network: Network, frame: Frame) -> list[Fault]:
        service = frame.id - self.watch.device.id
        if len(frame.data) != MESSAGE_BYTES[service]:
            return [self.watch.damaged(len(frame.data), MESSAGE_BYTES[service], service)]
        self._steady = frame.steady
        network.notify(frame.id, bytearray(frame.data), frame.steady)
        if service == SDO_RESPONSE:
            self._answered()
        faults, self._faults = self._faults, []
        return faults

    def start(self, now: float) -> None:
        """Send what is next on the way to operation, unless that was done a moment ago."""
        if (
            self.watch.state is NodeState.OPERATIONAL
            or now - self._attempted < constants.START_RETRY_S
        ):
            return
        self._attempted = now
        period = self.watch.device.heartbeat_period
        if period and not self._configured:
            if self._asked:
                self.problem = "no answer to the request for its heartbeat period"
            self._asked = True
            request = REQUEST_DOWNLOAD | TWO_BYTES, PRODUCER_HEARTBEAT_TIME, 0, round(period * 1e3)
            self._remote.sdo.send_request(struct.pack("<BHBHxx", *request))
        else:
            self._remote.nmt.state = "OPERATIONAL"

    def _heartbeat(self, number: int) -> None:
        self._faults += self.watch.heartbeat(number, self._steady)
        if self.watch.state is NodeState.BOOTED:  # it has forgotten what it was told
            self._configured, self._attempted = False, -math.inf

    def _emergency(self, error: EmcyError) -> None:
        self._faults += self.watch.emergency(error)
        self._remote.emcy.reset()  # its log has no end

    def _answered(self) -> None:
        try:
            confirmed = self._remote.sdo.read_response().startswith(CONFIRMED)
            problem = ""
        except canopen.SdoAbortedError as error:
            confirmed, problem = False, f"heartbeat period refused: {error}"
        if self._asked:  # and not another master
            self._asked, self._configured, self.problem = False, confirmed, problem
            if confirmed:
                self._attempted = -math.inf


class Devices:
    """All devices of a mapping; to be used by one thread. Times are of the steady clock [s]."""

    def __init__(self, settings: Mapping[str, Device]):
        self._network = Network()
        self.nodes = [Node(name, device, self._network) for name, device in settings.items()]
        self._owners = {
            service + node.watch.device.id: node for node in self.nodes for service in MESSAGE_BYTES
        }

    @property
    def operational(self) -> bool:
        """Return whether every device is in operation by its newest heartbeat."""
        return all(node.watch.state is NodeState.OPERATIONAL for node in self.nodes)

    def observe(self, frame: Frame) -> list[Fault] | None:
        node = None if frame.extended else self._owners.get(frame.id)
        return node.observe(self._network, frame) if node else None

    def check(self, now: float) -> list[Fault]:
        """Faults that show by heartbeats not coming; to be called in every cycle."""
        return [fault for node in self.nodes for fault in node.watch.check(now)]

    def start(self, now: float) -> list[Frame]:
        """Frames that bring the devices which are not in operation into it; none most of the time.

        To be called in every cycle in which devices may be started.
        """
        for node in self.nodes:
            node.start(now)
        frames, self._network.outbox = self._network.outbox, []
        return frames

    def take_log(self) -> list[str]:
        texts = [text for node in self.nodes for text in node.watch.log]
        for node in self.nodes:
            node.watch.log.clear()
        return texts
