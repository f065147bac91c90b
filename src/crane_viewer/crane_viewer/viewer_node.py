"""A node that shows topics in the view: it subscribes and does nothing else."""

import os
import time
from collections.abc import Sequence

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.serde import SerdeError

from crane_nodes.executor import KeptExecutor, Polled
from crane_nodes.managed import ros, say_ready
from crane_nodes.recording.bag import message_class
from crane_nodes.this_computer import schedule
from crane_viewer.view import SHOWN, View

VISIT_PERIOD_S = 0.1  # between two visits to the queues: rarely, so that looking costs little
# Messages of a topic that may wait for a visit, at 200 Hz ten times as many as come
VIEWER_DEPTH = 200


def show_topics(view: View, arguments: Sequence[str], beside: Sequence[int]) -> None:
    """Until SIGINT, SIGTERM or SIGHUP.

    This process and those `beside` it work only while no one else wants the cores: who looks must
    not hold up the crane. Not before all is there, which may take long then.
    """
    with ros(arguments) as stop:
        viewer = Viewer(view)
        for process in (os.getpid(), *beside):
            schedule(process, os.SCHED_IDLE)
        say_ready(viewer)
        executor = KeptExecutor()
        executor.add_node(viewer)
        while not stop.requested and rclpy.ok():
            executor.spin_once(timeout_sec=0.0)
            viewer.visit()
            time.sleep(VISIT_PERIOD_S)
        viewer.visit()  # what came last
        viewer.destroy_node()


class Viewer(Node):
    """It has no publisher for anything but its own log, and no client: it cannot move anything."""

    def __init__(self, view: View):
        super().__init__("viewer", start_parameter_services=False)
        self._view = view
        self._polled = [
            (
                topic,
                Polled(
                    self,
                    message_class(topic.msgtype),
                    topic.relative,
                    _quality(topic.latched),
                    raw=True,
                ),
            )
            for topic in SHOWN
        ]
        self._wrong: set[str] = set()

    def visit(self) -> None:
        for topic, polled in self._polled:
            if not (taken := list(polled.take())):
                continue
            received = [info["received_timestamp"] or time.time_ns() for _, info in taken]
            try:
                self._view.take(topic, received, [data for data, _ in taken])
            except (SerdeError, ValueError) as error:
                if topic.name not in self._wrong:
                    self._wrong.add(topic.name)
                    self.get_logger().warning(f"{topic.name} is not shown: {error}")


def _quality(latched: bool) -> QoSProfile:
    """Best effort: a publisher never waits for who only looks."""
    if latched:
        return QoSProfile(
            depth=VIEWER_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
    return QoSProfile(depth=VIEWER_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
