"""Pressures passed on to a node, until a test loses them; by a process that is never late.

A controller takes pressures for lost that come 50 ms late, as a test passes them on at times.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from integration.processes import CONTROLLER_PRIORITY, PATIENCE, start

SHOWN = "/shown_pressures"
PASSING = f"""
import os, sys, threading, rclpy
from rclpy.executors import SingleThreadedExecutor
from crane_nodes.scheduling import prefer
from crane_interfaces.msg import CylinderPressures
prefer(os.getpid(), {CONTROLLER_PRIORITY})
rclpy.init()
node = rclpy.create_node("passing")
shown = node.create_publisher(CylinderPressures, "{SHOWN}", 10)
measured = node.create_subscription(CylinderPressures, "/cylinder_pressures", shown.publish, 10)
executor = SingleThreadedExecutor()
executor.add_node(node)
while not (measured.get_publisher_count() and shown.get_subscription_count()):
    executor.spin_once(timeout_sec=0.1)
print("begins", flush=True)
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
while not ended.is_set():
    executor.spin_once(timeout_sec=0.1)
rclpy.shutdown()
"""


class ShownPressures:
    """What the driver measures, on `SHOWN`."""

    def __init__(self) -> None:
        self._process = start(PASSING)
        assert self._process.stdout
        assert self._process.stdout.readline()  # it has begun

    def lose(self) -> None:
        """Pass on no more of them."""
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait(PATIENCE)


@contextmanager
def shown_pressures() -> Iterator[ShownPressures]:
    """They are passed on within the `with` block, or until they are lost."""
    one = ShownPressures()
    try:
        yield one
    finally:
        one.lose()
