"""A publisher of valve commands, as a process of its own."""

import json

from integration.processes import CONTROLLER_PRIORITY, PATIENCE, start

COMMANDER = f"""
import json, os, sys, threading, time, rclpy
from rclpy.node import Node
from crane_nodes.scheduling import prefer
from crane_interfaces.msg import ValveCommand
prefer(os.getpid(), {CONTROLLER_PRIORITY})
command = {{}}
done = threading.Event()
def read():
    global command
    for line in sys.stdin:
        command = json.loads(line)
    done.set()
threading.Thread(target=read, daemon=True).start()
rclpy.init(args=sys.argv)
node = Node("commander")
publisher = node.create_publisher(ValveCommand, "valve_command", 10)
while not done.is_set():
    now = command
    if now is not None:
        message = ValveCommand(name=list(now), command=[float(v) for v in now.values()])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)
    time.sleep(0.01)
rclpy.shutdown()
"""


class Commander:
    """A process that publishes commands at 100 Hz."""

    def __init__(self, *arguments: str) -> None:
        self.process = start(COMMANDER, *arguments)
        self.send()

    def send(self, **commands: float) -> None:
        self._tell(commands)

    def pause(self) -> None:
        """Stay there as a publisher, but publish nothing."""
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
