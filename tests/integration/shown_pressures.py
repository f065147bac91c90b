"""Pressures passed on to a node, until a test loses them."""

from collections.abc import Iterator
from contextlib import contextmanager

from integration.driver_stage import Stage
from integration.processes import PATIENCE, start

SHOWN = "/shown_pressures"
PASSING = f"""
import sys, threading, rclpy
from crane_interfaces.msg import CylinderPressures
from crane_nodes.executor import KeptExecutor
from crane_nodes.node_time import NodeTime, Pacing
rclpy.init(args=sys.argv)
node = rclpy.create_node("passing")
clock = NodeTime(node)
clock.listen()
pacing = Pacing(node, clock, 0.02)
shown = node.create_publisher(CylinderPressures, "{SHOWN}", 10)
measured = node.create_subscription(CylinderPressures, "/cylinder_pressures", shown.publish, 10)
executor = KeptExecutor()
executor.add_node(node)
ended = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
begun = False
while not ended.is_set():
    executor.spin_once(timeout_sec=0.1)
    pacing.taken()
    if not begun and measured.get_publisher_count() and shown.get_subscription_count():
        begun = True
        print("begins", flush=True)
rclpy.shutdown()
"""


class ShownPressures:
    """What the driver measures, on `SHOWN`."""

    def __init__(self, stage: Stage) -> None:
        self._process = start(PASSING, *stage.ros())
        assert self._process.stdout
        assert self._process.stdout.readline()  # it has begun

    def lose(self) -> None:
        """Pass on no more of them."""
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait(PATIENCE)


@contextmanager
def shown_pressures(stage: Stage) -> Iterator[ShownPressures]:
    """They are passed on within the `with` block, or until they are lost."""
    one = ShownPressures(stage)
    try:
        yield one
    finally:
        one.lose()
