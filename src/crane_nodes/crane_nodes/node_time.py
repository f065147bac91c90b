"""The time of a node: the steady clock, or simulated time where `use_sim_time` is set."""

import time
from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from crane_bags.clocks import NANOSECONDS, TimeBack
from crane_nodes.this_computer import PATIENCE_S

CLOCK_TOPIC = "clock"  # of the namespace: each simulated crane has its own time
TAKEN_TOPIC = "lock_step"
NEWEST_TICK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
REAL_DEPTH, SIMULATED_DEPTH = 10, 1000  # messages
CLOCK_PROFILE = QoSProfile(depth=SIMULATED_DEPTH)
TAKEN_PROFILE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def nanoseconds(stamp: Time) -> int:
    """A stamp as one number."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def stamp_of(time: int) -> Time:
    """The stamp of a time in nanoseconds."""
    seconds, nanosec = divmod(time, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanosec)


class NodeTime:
    """Tells a node the time by which its limits and timeouts count.

    Timers of the nodes run on the steady clock in both cases: they look at what there is, and this
    time judges it. If `/clock` falls silent for `PATIENCE_S`, simulated time goes on with the
    steady clock, so that whoever waits for a process that has died finds out as ever.
    """

    def __init__(self, node: Node):
        self._node = node
        self.simulated: bool = node.get_parameter("use_sim_time").value is True
        self.depth = SIMULATED_DEPTH if self.simulated else REAL_DEPTH
        """Depth of a publisher whose messages a starved process must not lose."""
        self._heard = time.monotonic()
        self._newest = 0
        self.known = not self.simulated
        """Whether the time is known; simulated time is unknown before the first tick."""
        source = node._time_source
        self._told: Callable[[Clock], None] = source.clock_callback
        if source._clock_sub is not None:  # which does not tell that the clock is alive
            node.destroy_subscription(source._clock_sub)
            source._clock_sub = None

    def listen(self) -> None:
        """Subscribe to the clock of the namespace; the driver, which publishes it, does not."""
        if self.simulated:
            self._node.create_subscription(Clock, CLOCK_TOPIC, self.tell, NEWEST_TICK)

    def tell(self, message: Clock) -> None:
        """Take the time that a message of `/clock` tells."""
        self._heard = time.monotonic()
        self._newest, self.known = nanoseconds(message.clock), True
        self._told(message)

    def now(self) -> float:
        """Time [s]; its zero has no meaning."""
        if not self.simulated:
            return time.monotonic()
        silent = time.monotonic() - self._heard
        return self._newest / NANOSECONDS + max(0.0, silent - PATIENCE_S)

    def patience(self, seconds: float) -> float:
        """Real time [s] to wait for an answer that an idle computer gives within `seconds`.

        In simulated time it may have to wait for the slowest node.
        """
        return max(seconds, PATIENCE_S) if self.simulated else seconds

    def of(self, stamp: Time) -> float:
        """Time [s] at which a message with this stamp is handled.

        In simulated time it is that of the stamp: the message may come before its tick of `/clock`.
        """
        if not self.simulated:
            return time.monotonic()
        time_of_message = nanoseconds(stamp)
        if time_of_message > self._newest:  # /clock may wait behind it, while an executor is held
            self._newest, self._heard = time_of_message, time.monotonic()
            self.known = True
        return time_of_message / NANOSECONDS

    def stamp(self) -> Time:
        if self.simulated:
            return stamp_of(self._newest)
        return self._node.get_clock().now().to_msg()


def tell_back(back: TimeBack, status: DiagnosticStatus) -> None:
    """Add to a status how often time went back, and a warning while that is news."""
    status.values = [
        *status.values,
        KeyValue(key="time went back [-]", value=str(back.times)),
        KeyValue(key="time went back, the last time [s]", value=f"{back.by:.3f}"),
    ]
    if back.is_news:
        status.level = max(status.level, DiagnosticStatus.WARN)
        status.message = f"{back}; {status.message}"


class Pacing:
    """Tells the driver how far a node has come in simulated time, so that it is not left behind.

    The crane goes no further ahead than `ahead` [s].
    """

    def __init__(self, node: Node, clock: NodeTime, ahead: float):
        self._node, self._clock = node, clock
        self._ahead, self._told = round(ahead * NANOSECONDS), -NANOSECONDS
        self._name = node.get_fully_qualified_name()
        self._publisher: Any = (
            node.create_publisher(Header, TAKEN_TOPIC, TAKEN_PROFILE) if clock.simulated else None
        )
        self.taken()  # from now on this node is waited for

    def taken(self) -> None:
        """Say that all that came up to now was taken."""
        if self._publisher is None:
            return
        now = nanoseconds(self._clock.stamp())
        if 0 <= now - self._told < self._ahead // 4:
            return
        self._told = now
        self._publisher.publish(Header(stamp=stamp_of(now + self._ahead), frame_id=self._name))

    def close(self) -> None:
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
