"""The player as a node: publishes the messages of a bag when they are due, and the bag's time."""

import time
from collections.abc import Callable, Collection, Iterable, Sequence

from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from crane_bags.clocks import NANOSECONDS
from crane_model.errors import DataError
from crane_nodes.context import Stop
from crane_nodes.executor import KeptExecutor
from crane_nodes.names import full_name
from crane_nodes.publishers import NameLooks, publishers
from crane_nodes.ready import say_ready
from crane_nodes.recording.definitions import message_class
from crane_nodes.recording.playback import CLOCK, Due, PlaybackPace, PlayedTopic
from crane_nodes.recording.ros import profile

TICK_PERIOD_NS = 10_000_000  # ns between two messages on /clock
LOOK_PERIOD_NS = NANOSECONDS  # ns between two looks for other publishers
LAST_MESSAGES_TIMEOUT_S = 10.0  # that subscribers have to acknowledge what was sent last
HISTORY = 5000  # messages, 25 s at 200 Hz, kept for subscribers that fall behind or are just found


class Player(Node):
    """Stands in the place of the publishers of a bag."""

    def __init__(self, stop: Stop):
        super().__init__("player")
        self._stop = stop
        self._worker = KeptExecutor()
        self._worker.add_node(self)
        self._time = self.create_publisher(Clock, CLOCK, QoSProfile(depth=10))
        self._publishers_of: dict[str, Publisher] = {}  # recorded topic -> publisher
        self._contested: set[str] = set()
        self._looks = NameLooks()
        self._next_tick = self._next_look = 0

    def expanded(self, topic: str) -> str:
        """A topic of the command line in full; a relative name is one of the node's namespace."""
        return expand_topic_name(topic, self.get_name(), self.get_namespace())

    def offer(self, topics: Sequence[PlayedTopic]) -> None:
        """Make the publishers of these topics.

        Their history is longer than the recorded one, which a bag played fast overruns before a
        subscriber that has just been found is told of the first messages. It is no part of what
        publishers offer; only a latched topic shows it to those who come later.
        """
        for topic in topics:
            qos = profile(topic.service)
            if not topic.service.latched:
                qos.depth = max(qos.depth, HISTORY)
            self._publishers_of[topic.recorded] = self.create_publisher(
                message_class(topic.msgtype), topic.recorded, qos
            )
        say_ready(self)

    def wait_for_subscribers(self, topics: Collection[str]) -> None:
        """Wait until each of `topics` is subscribed to; `DataError` if one is not played."""
        played = (self._time, *self._publishers_of.values())
        publishers = {one.topic_name: one for one in played}
        names = [self.resolve_topic_name(topic) for topic in topics]
        if others := [name for name in names if name not in publishers]:
            raise DataError(
                f"cannot wait for subscribers of {', '.join(others)}: not played; played are "
                f"{', '.join(publishers)}"
            )
        while not self._stop.requested and any(
            publishers[name].get_subscription_count() == 0 for name in names
        ):
            self._worker.spin_once(timeout_sec=0.05)

    def play(
        self, messages: Iterable[Due], rate: float, played: Callable[[int, int], None]
    ) -> None:
        """Publish `messages` in the rhythm of their times, `rate` times as fast.

        After each one `played` is called with its time in the bag and its delay, both in ns.
        """
        pace: PlaybackPace | None = None
        for message in messages:
            pace = pace or PlaybackPace(message.time, time.monotonic_ns(), rate)
            due = pace.steady(message.time)
            self._pass_time(pace, due)
            if self._stop.requested:
                return
            self._publishers_of[message.topic].publish(message.data)
            played(message.time, time.monotonic_ns() - due)

    def finish(self) -> None:
        """Wait, not for long, until subscribers have what was sent last."""
        until = time.monotonic() + LAST_MESSAGES_TIMEOUT_S
        for publisher in self._publishers_of.values():
            left = max(0.0, until - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))

    def _pass_time(self, pace: PlaybackPace, until: int) -> None:
        """Publish the time, and answer requests to the node, until a moment of the steady clock."""
        while True:
            now = time.monotonic_ns()
            if now >= self._next_tick:
                self._next_tick = now + TICK_PERIOD_NS
                self._tick(pace.bag(now))
                self._worker.spin_once(timeout_sec=0.0)
                if now >= self._next_look:
                    self._next_look = now + LOOK_PERIOD_NS
                    self._look_for_others()
            elif now >= until or self._stop.requested:
                return
            else:
                time.sleep((min(until, self._next_tick) - now) / NANOSECONDS)

    def _tick(self, bag_time: int) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(bag_time, NANOSECONDS)
        self._time.publish(message)

    def _look_for_others(self) -> None:
        """Warn of live publishers: what is subscribed to is then neither live nor recorded."""
        for publisher in self._publishers_of.values():
            name = publisher.topic_name
            if name not in self._contested and self.count_publishers(name) > 1:
                nodes = publishers(self, name)
                if not self._looks.suffice(name, nodes):
                    continue
                self._contested.add(name)
                others = ", ".join(one for one in nodes if one != full_name(self))
                self.get_logger().warning(
                    f"{name} is also published by {others}: "
                    "subscribers get both; stop one of them, or leave the topic out by --topics"
                )
