"""A controller reduced to its rhythm: one valve command for every joint state, at once.

`python live_controller.py`, until SIGTERM; then it says how often it had to enable the driver.
"""

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from crane_interfaces.msg import ValveCommand
from crane_nodes import DriverClient, ros

STEP = 0.0005  # of the spool signal
VALUES = 99  # neutral commands that can be told apart on the bus
RETRY = 1.0  # s


class Controller(Node):
    """Answers with the time stamp of the joint state; the value tells its answers apart."""

    def __init__(self) -> None:
        super().__init__("controller")
        self.enabled = 0
        self._count = 0
        self._commands = self.create_publisher(ValveCommand, "/valve_command", 10)
        self._driver = DriverClient(self)
        self.create_subscription(JointState, "/joint_states", self._answer, 10)
        self.create_timer(RETRY, self._keep_enabled)

    def _answer(self, state: JointState) -> None:
        self._count = self._count % VALUES + 1
        command = ValveCommand(name=["slew"], command=[self._count * STEP])
        command.header.stamp = state.header.stamp
        self._commands.publish(command)

    def _keep_enabled(self) -> None:
        """Enable the driver, and again after a fault; refused while it is enabled."""
        if self._driver.ready:
            self._driver.reset_fault()
            self._driver.enable().add_done_callback(self._told)

    def _told(self, future: rclpy.Future) -> None:
        self.enabled += future.result().success


def main() -> None:
    with ros(sys.argv[1:]) as stop:
        node = Controller()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop.requested:
            executor.spin_once(timeout_sec=0.1)
        print(f"enabled {node.enabled} times", flush=True)


if __name__ == "__main__":
    main()
