"""A CANopen encoder of the `canopen` library as a process of its own, on simulated time."""

from integration.driver_stage import Stage
from integration.processes import PATIENCE, start

HEARTBEAT_PERIOD = 0x1017  # object: producer heartbeat time
DEVICE = f"""
import sys, threading
import canopen, rclpy
from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.datatypes import UNSIGNED16
from crane_driver.can.bus import BusSettings, open_bus
from crane_nodes.executor import KeptExecutor
from crane_nodes.node_time import NodeTime, Pacing
rclpy.init(args=sys.argv)
ros = rclpy.create_node("device")
clock = NodeTime(ros)
clock.listen()
pacing = Pacing(ros, clock, 0.1)
executor = KeptExecutor()
executor.add_node(ros)
class Beat:  # by simulated time, in the place of the timer of the library
    def __init__(self, identifier, data, period, remote=False):
        self.identifier, self.data, self.period, self.due = identifier, data, period, clock.now()
        beats.add(self)
    def update(self, data):
        self.data = data
    def stop(self):
        beats.discard(self)
beats = set()
dictionary = ObjectDictionary()
period = ODVariable("Producer heartbeat time", {HEARTBEAT_PERIOD})
period.data_type, period.default = UNSIGNED16, 0
dictionary.add_object(period)
network = canopen.Network(open_bus(BusSettings(extra={{"port": int(sys.argv[1])}})))
network.connect()
network.send_periodic = Beat
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
def obey():
    for line in sys.stdin:
        globals()[line.strip()]()
    ended.set()
ended = threading.Event()
threading.Thread(target=obey, daemon=True).start()
while not ended.is_set():
    executor.spin_once(timeout_sec=0.1)
    for beat in list(beats):
        if clock.now() >= beat.due:
            network.send_message(beat.identifier, beat.data)
            beat.due += beat.period
    pacing.taken()
node.nmt.stop_heartbeat()
network.disconnect()
rclpy.shutdown()
"""


class CanopenDevice:
    """It makes heartbeats only when it is told to, as they come from the factory."""

    def __init__(self, stage: Stage, number: int):
        self._process = start(DEVICE, str(stage.port), str(number), *stage.ros())

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
