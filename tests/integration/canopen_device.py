"""A CANopen encoder of the `canopen` library as a process of its own, which is never late.

As a thread of the test its heartbeats would stop with the test, which is a true fault.
"""

from integration.processes import MACHINE_PRIORITY, PATIENCE, start

HEARTBEAT_PERIOD = 0x1017  # object: producer heartbeat time
DEVICE = f"""
import os, sys
import canopen
from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.datatypes import UNSIGNED16
from crane_driver.can.bus import BusSettings, open_bus
from crane_nodes.scheduling import prefer
prefer(os.getpid(), {MACHINE_PRIORITY})
dictionary = ObjectDictionary()
period = ODVariable("Producer heartbeat time", {HEARTBEAT_PERIOD})
period.data_type, period.default = UNSIGNED16, 0
dictionary.add_object(period)
network = canopen.Network(open_bus(BusSettings(extra={{"port": int(sys.argv[1])}})))
network.connect()
node = network.create_node(int(sys.argv[2]), dictionary)
def boot():
    node.sdo[{HEARTBEAT_PERIOD}].raw = 0
    node.nmt.state = "INITIALISING"
    node.nmt.state = "PRE-OPERATIONAL"
def fall_silent():
    node.nmt.stop_heartbeat()
def stop():
    node.nmt.state = "STOPPED"
def report_emergency():
    node.emcy.send(0x5000, 0x01, b"\\x2a")
    node.emcy.reset()
def tell():
    print(node.nmt.state, node.sdo[{HEARTBEAT_PERIOD}].raw, flush=True)
for line in sys.stdin:
    globals()[line.strip()]()
node.nmt.stop_heartbeat()
network.disconnect()
"""


class CanopenDevice:
    """It makes heartbeats only when it is told to, as they come from the factory."""

    def __init__(self, port: int, number: int):
        self._process = start(DEVICE, str(port), str(number))

    def boot(self) -> None:
        self._do("boot")

    def fall_silent(self) -> None:
        """Make no more heartbeats."""
        self._do("fall_silent")

    def stop(self) -> None:
        """Go to the state stopped."""
        self._do("stop")

    def report_emergency(self) -> None:
        """Hardware of the device, and that it is over."""
        self._do("report_emergency")

    @property
    def state(self) -> str:
        """Of its network management."""
        return self._told()[0]

    @property
    def heartbeat_period(self) -> int:
        """As it was told, 0 at first [ms]."""
        return int(self._told()[1])

    def close(self) -> None:
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait(PATIENCE)

    def _told(self) -> list[str]:
        self._do("tell")
        assert self._process.stdout
        return self._process.stdout.readline().split()

    def _do(self, what: str) -> None:
        assert self._process.stdin
        self._process.stdin.write(what + "\n")
        self._process.stdin.flush()
