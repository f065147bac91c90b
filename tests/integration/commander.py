"""A publisher of valve commands, as a process of its own."""

import json

from integration.processes import PATIENCE, start

COMMANDER = """
import json, queue, sys, threading, rclpy
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from crane_interfaces.msg import ValveCommand
from crane_nodes.executor import KeptExecutor
from crane_nodes.node_time import CLOCK_TOPIC, NEWEST_TICK, NodeTime
command, paused, done = {}, False, threading.Event()
told = queue.SimpleQueue()  # each is published once at least
def read():
    for line in sys.stdin:
        told.put(json.loads(line))
    done.set()
threading.Thread(target=read, daemon=True).start()
rclpy.init(args=sys.argv)
node = rclpy.create_node("commander")
clock = NodeTime(node)
publisher = node.create_publisher(ValveCommand, "valve_command", 10)
message = ValveCommand()
def publish():
    global command, message, paused
    if not told.empty():
        command = told.get()
    if command is not None:
        message = ValveCommand(name=list(command), command=[float(v) for v in command.values()])
        message.header.stamp = clock.stamp()
    elif not paused:
        message.header.stamp = Time()  # answers no cycle: the driver waits for no further command
    if command is not None or not paused:
        publisher.publish(message)
    paused = command is None
def tick(message):
    clock.tell(message)
    publish()
if clock.simulated:
    node.create_subscription(Clock, CLOCK_TOPIC, tick, NEWEST_TICK)
else:
    node.create_timer(0.01, publish)
executor = KeptExecutor()
executor.add_node(node)
while not done.is_set():
    executor.spin_once(timeout_sec=0.1)
rclpy.shutdown()
"""


class Commander:
    """A process that publishes commands: one for each cycle of simulated time, or at 100 Hz."""

    def __init__(self, *arguments: str) -> None:
        self.process = start(COMMANDER, *arguments)
        self.send()

    def send(self, **commands: float) -> None:
        self._tell(commands)

    def pause(self) -> None:
        """Stay there as a publisher, but publish nothing; simulated time goes on."""
        self._tell(None)

    def end(self) -> None:
        """Leave the graph: one that is killed is missed by others only after 20 s."""
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait(PATIENCE)

    def _tell(self, what: object) -> None:
        assert self.process.stdin
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
