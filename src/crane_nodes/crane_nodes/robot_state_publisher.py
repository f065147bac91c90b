"""`ros2 run crane_nodes robot_state_publisher`: that of ROS, with the URDF that a driver publishes.

That one wants the URDF at its start, as a parameter; the driver has it, on whichever computer.
"""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import rclpy
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from rclpy.node import Node
from std_msgs.msg import String

from crane_model.cli import command_line, run
from crane_model.errors import ConfigurationError
from crane_nodes.driver_client import LATCHED
from crane_nodes.managed import own_arguments, ros, ros_arguments

NAME = "robot_state_publisher"
PROGRAM = f"lib/{NAME}/{NAME}"
URDF_TOPIC = "robot_description"
WAKE_PERIOD_OF_WAIT_S = 0.1


class Awaited(Node):
    """Takes the URDF, and where its frames belong."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self.urdf: str | None = None
        topic = self.create_subscription(String, URDF_TOPIC, self._take, LATCHED)
        self.get_logger().info(f"waiting for a driver to publish {topic.topic_name}")
        namespace = self.get_namespace().strip("/")
        self.frame_prefix = f"{namespace}/" if namespace else ""

    def _take(self, message: String) -> None:
        self.urdf = message.data


def main(argv: Sequence[str] | None = None) -> int:
    """Wait for the URDF, then become the program of ROS."""
    argv = sys.argv[1:] if argv is None else argv
    parser = command_line(
        prog=NAME,
        description="Waits for the URDF of a driver, then runs the robot_state_publisher of ROS "
        "with it: transforms of all links, from base_link to tip. In a namespace, frame names "
        "begin with it.",
        epilog="ROS arguments follow --ros-args, and may override arguments of the program.",
    )
    parser.parse_args(own_arguments(argv))
    return run(lambda: _become(argv))


def _become(argv: Sequence[str]) -> None:
    program = _program()
    with ros(argv) as stop:
        node = Awaited()
        while node.urdf is None:
            rclpy.spin_once(node, timeout_sec=WAKE_PERIOD_OF_WAIT_S)
            if stop.requested:
                return
        given = {
            "robot_description": json.dumps(node.urdf),  # a string of YAML as well
            "frame_prefix": json.dumps(node.frame_prefix),
        }
        node.destroy_node()
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    again = [
        "-r",
        f"{URDF_TOPIC}:=~/{URDF_TOPIC}",
    ]  # it publishes it too; that of the driver is enough
    os.execv(program, [str(program), "--ros-args", *words, *again, *ros_arguments(argv)])


def _program() -> Path:
    """The program of ROS; `ConfigurationError` where it is not installed."""
    try:
        return Path(get_package_prefix(NAME), PROGRAM)
    except PackageNotFoundError:
        raise ConfigurationError(
            f"no package {NAME} of ROS is installed (ROS as Python packages has none); "
            "run: apt install ros-jazzy-robot-state-publisher"
        ) from None
