"""Processes of the suite and a ROS graph around them, for the tests of recorder and player."""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python.packages import get_package_prefix
from integration.processes import PATIENCE
from laboratory_crane import JOINTS, PLANAR_JOINTS
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from crane_interfaces.msg import CylinderPressures, JointReference, ValveCommand

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
KEPT = 2000  # messages, to be sent again where the sockets of a busy machine lose some


def program(package: str, name: str) -> Path:
    """An executable of a package."""
    return Path(get_package_prefix(package)) / "lib" / package / name


def run(package: str, name: str, *arguments: object) -> None:
    """Let an executable work to its end."""
    command = [str(program(package, name)), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


class Process:
    """An executable at work."""

    def __init__(self, folder: Path, package: str, name: str, *arguments: object):
        command = [str(program(package, name)), *map(str, arguments)]
        self._output = folder / f"{name}.out"
        with self._output.open("w") as output:
            self.process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)

    @property
    def output(self) -> str:
        """What it has printed so far."""
        return self._output.read_text()

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def end(self, *signals: signal.Signals) -> int:
        """Send signals, wait for its end; its exit status."""
        for one in signals:
            self.process.send_signal(one)
        return self.process.wait(PATIENCE)


@dataclass
class Graph:
    """A node in a domain of this test, and the processes that it started."""

    node: Node
    executor: SingleThreadedExecutor
    folder: Path
    processes: list[Process] = field(default_factory=list)

    def start(self, name: str, *arguments: object, package: str = "crane_nodes") -> Process:
        self.processes.append(Process(self.folder, package, name, *arguments))
        return self.processes[-1]

    def wait(self, condition: Callable[[], object]) -> None:
        """Let the node work until the condition holds; a process that fails ends the test."""
        until = time.monotonic() + PATIENCE
        while not condition():
            for process in self.processes:
                assert process.process.poll() in (None, 0), process.output
            assert time.monotonic() < until, [process.output for process in self.processes]
            self.executor.spin_once(timeout_sec=0.05)


@contextmanager
def graph(domain: int, folder: Path) -> Iterator[Graph]:
    """A graph; processes that a test left behind are ended."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("test", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    made = Graph(node, executor, folder)
    try:
        yield made
    finally:
        for process in made.processes:
            if process.running:
                process.end(signal.SIGKILL)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)


class Source:
    """The topics of a crane at 200 Hz, as its nodes publish them, and what was sent on them."""

    RATE = 200.0  # Hz

    def __init__(self, graph: Graph):
        self._graph = graph
        names, planar = list(JOINTS), list(PLANAR_JOINTS)
        four, three = [0.0] * 4, [0.0] * 3
        self._messages: dict[str, Any] = {
            "/joint_states": JointState(name=names, position=four, velocity=four, effort=four),
            "/cylinder_pressures": CylinderPressures(name=planar, chamber_a=three, chamber_b=three),
            "/valve_command": ValveCommand(name=names, command=four),
            "/joint_reference": JointReference(
                name=names, position=four, velocity=four, acceleration=four
            ),
        }
        self.publishers: dict[str, Publisher] = {
            topic: graph.node.create_publisher(type(message), topic, KEPT)
            for topic, message in self._messages.items()
        }
        self.description = graph.node.create_publisher(String, "/robot_description", LATCHED)
        self.description.publish(String(data="<robot name='crane'/>"))
        self.stamps: list[int] = []  # ns; all topics carry the same ones

    def wait_for_subscribers(self) -> None:
        publishers = [*self.publishers.values(), self.description]
        self._graph.wait(lambda: all(one.get_subscription_count() for one in publishers))

    def send(self, count: int) -> None:
        """Publish `count` messages on each topic in their rhythm, never faster to catch up."""
        due = time.monotonic()
        for _ in range(count):
            time.sleep(max(0.0, due - time.monotonic()))
            due = max(due, time.monotonic() - 1.0 / self.RATE) + 1.0 / self.RATE
            self.stamps.append(time.time_ns())
            for topic, message in self._messages.items():
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                    self.stamps[-1], 10**9
                )
                self.publishers[topic].publish(message)

    def wait_until_received(self) -> None:
        """Wait until every subscriber has acknowledged everything."""
        for publisher in self.publishers.values():
            assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
