"""Who commands the valves: this node while it leads the crane, and no other meanwhile."""

from collections.abc import Sequence

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher

from crane_interfaces.msg import ValveCommand
from crane_nodes.names import full_name
from crane_nodes.node_time import NodeTime
from crane_nodes.publishers import publishers
from crane_trajectory.trajectory_topics import command_message

TOPIC = "valve_command"


class Valves:
    """The topic valve_command of `node`, on which it publishes from `open` to `close`."""

    def __init__(self, node: Node, clock: NodeTime, joints: Sequence[str]):
        self._node, self._clock, self._joints = node, clock, joints
        self._publisher: Publisher | None = None

    def open(self) -> None:
        """Be the one who commands the valves."""
        self._publisher = self._node.create_publisher(ValveCommand, TOPIC, self._clock.depth)

    def close(self) -> None:
        """Command the valves no more."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    def send(self, u: np.ndarray | None) -> None:
        """Spool commands (j,), between -1 and 1; None where there are none to send."""
        if u is not None and self._publisher is not None:
            self._publisher.publish(command_message(u, self._clock.stamp(), self._joints))

    @property
    def rivals(self) -> str:
        """Who else may command the valves, and what to do; empty if nobody does."""
        others = [one for one in publishers(self._node, TOPIC) if one != full_name(self._node)]
        if not others:
            return ""
        return f"{', '.join(others)} may command the valves, only one may; stop it"

    @property
    def unheard(self) -> str:
        """Where nobody listens to the commands; empty if the driver does, or none are sent."""
        if self._publisher is None or self._publisher.get_subscription_count():
            return ""
        return f"no driver listens to {self._publisher.topic_name}"
