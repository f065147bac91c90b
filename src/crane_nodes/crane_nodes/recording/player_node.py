"""`ros2 run crane_nodes player`: a bag onto the topics it was recorded from.

The node publishes the messages of the bag when they are due, and the time of the bag.
"""

import argparse
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock

from crane_bags.clocks import NANOSECONDS
from crane_bags.storage import announced, messages, open_bag
from crane_bags.types import VALVE_COMMAND
from crane_model.cli import above, command_line, run
from crane_model.errors import DataError
from crane_model.progress_bar import BAR, progress_bar
from crane_nodes.executor import KeptExecutor
from crane_nodes.managed import (
    NameLooks,
    Stop,
    full_name,
    own_arguments,
    publishers,
    ros,
    say_ready,
)
from crane_nodes.recording.bag import installed_definition, message_class
from crane_nodes.recording.ros import Service, offer, profile

COMMAND_NAME = VALVE_COMMAND.name.rpartition("/")[2]
CLOCK_NAME = "clock"  # of the namespace

TICK_PERIOD_NS = 10_000_000  # ns between two messages on /clock
LOOK_PERIOD_NS = NANOSECONDS  # ns between two looks for other publishers
LAST_MESSAGES_TIMEOUT_S = 10.0  # that subscribers have to acknowledge what was sent last
# Messages, 25 s at 200 Hz, kept for subscribers that fall behind or are just found
HISTORY_MESSAGES = 5000

SECONDS_BAR = "{desc}: {n:.1f} of {total:.1f} s" + BAR


@dataclass(frozen=True)
class PlayedTopic:
    """A topic of a bag and what stands in the place of its publishers."""

    recorded: str
    name: str  # onto which it is played
    msgtype: str
    service: Service


@dataclass(frozen=True)
class Selection:
    """Topics that are played, and for each one left out the reason."""

    played: tuple[PlayedTopic, ...]
    left_out: Mapping[str, str]


def select(
    path: Path,
    reader: Reader,
    topics: Collection[str],
    allow_valve_command: bool,
    resolve: Callable[[str], str],
) -> Selection:
    """Find the playable ones of the `topics` of a bag (none: of all).

    `resolve` gives the name onto which a recorded topic is played; none is played onto a valve
    command, in whatever namespace, unless that is allowed. `DataError` if a topic is not in the bag
    or nothing is left to play.
    """
    recorded = sorted({connection.topic for connection in reader.connections})
    if absent := [name for name in topics if name not in recorded]:
        raise DataError(
            f"{path}: no topic {', '.join(absent)}; the bag holds {', '.join(recorded)}"
        )
    played, left_out = [], {}
    for name in sorted(topics) or recorded:
        found = [connection for connection in reader.connections if connection.topic == name]
        onto, msgtype = resolve(name), found[0].msgtype
        if reason := _obstacle(reader, found, onto, allow_valve_command):
            left_out[name] = reason
        else:
            extensions = [cast(ConnectionExtRosbag2, connection.ext) for connection in found]
            profiles = [qos for extension in extensions for qos in extension.offered_qos_profiles]
            played.append(PlayedTopic(name, onto, msgtype, offer(profiles)))
    if not played:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise DataError(f"{path}: nothing to play ({reasons})")
    return Selection(tuple(played), left_out)


def _obstacle(reader: Reader, found: Sequence[Connection], onto: str, allow: bool) -> str:
    """Why a topic is not played; empty if it is."""
    name, msgtype = found[0].topic, found[0].msgtype
    if onto.rpartition("/")[2] == COMMAND_NAME and not allow:
        return "would move the crane; --allow-valve-command plays it"
    if onto.rpartition("/")[2] == CLOCK_NAME:
        return "the time of the bag is played there"
    if len({connection.msgtype for connection in found}) > 1:
        return "has messages of more than one type"
    try:
        message_class(msgtype)
        definition = installed_definition(msgtype)
    except DataError as error:
        return str(error)
    if announced(reader, name)[1] - {definition.type_hash}:
        return f"recorded with another definition of {msgtype} than the installed one"
    return ""


@dataclass(frozen=True)
class Due:
    """A message and the time at which it is played."""

    time: int  # ns, of the bag
    topic: str  # as recorded
    data: bytes


def schedule(path: Path, reader: Reader, selection: Selection) -> Iterator[Due]:
    """The messages in the order of the bag."""
    for connection, log_time, data in messages(
        path, reader, [topic.recorded for topic in selection.played]
    ):
        yield Due(log_time, connection.topic, bytes(data))


class PlaybackPace:
    """Time of the bag on the steady clock; both in ns.

    `rate` seconds of the bag pass in one second.
    """

    def __init__(self, bag_start: int, steady_start: int, rate: float):
        self._bag_start, self._steady_start, self._rate = bag_start, steady_start, rate

    def steady(self, bag_time: int) -> int:
        return self._steady_start + round((bag_time - self._bag_start) / self._rate)

    def bag(self, steady_time: int) -> int:
        return self._bag_start + round((steady_time - self._steady_start) * self._rate)


class Player(Node):
    """Stands in the place of the publishers of a bag."""

    def __init__(self, stop: Stop):
        super().__init__("player")
        self._stop = stop
        self._worker = KeptExecutor()
        self._worker.add_node(self)
        self._time = self.create_publisher(Clock, CLOCK_NAME, QoSProfile(depth=10))
        self._publishers_of: dict[str, Publisher] = {}  # recorded topic -> publisher
        self._contested: set[str] = set()
        self._looks = NameLooks()
        self._next_tick = self._next_look = 0

    def expanded(self, topic: str) -> str:
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
                qos.depth = max(qos.depth, HISTORY_MESSAGES)
            self._publishers_of[topic.recorded] = self.create_publisher(
                message_class(topic.msgtype), topic.recorded, qos
            )
        say_ready(self)

    def wait_for_subscribers(self, topics: Collection[str]) -> None:
        """Wait until each of `topics` is subscribed to; `DataError` if one is not played."""
        played = (self._time, *self._publishers_of.values())
        publishers = {publisher.topic_name: publisher for publisher in played}
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
                others = ", ".join(node for node in nodes if node != full_name(self))
                self.get_logger().warning(
                    f"{name} is also published by {others}: "
                    "subscribers get both; stop one of them, or leave the topic out by --topics"
                )


@dataclass(frozen=True, kw_only=True)
class PlayRequest:
    """Request of the command line."""

    bag: Path
    rate: float  # times as fast
    topics: Sequence[str]  # empty: all
    loop: bool
    wait_for: Sequence[str]  # topics that need a subscriber first
    allow_valve_command: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Play a bag to its end."""
    argv = sys.argv[1:] if argv is None else argv
    request = PlayRequest(**vars(_parser().parse_args(own_arguments(argv))))
    return run(lambda: _play(argv, request))


def _play(argv: Sequence[str], request: PlayRequest) -> None:
    bag = request.bag
    with ros(argv) as stop, open_bag(bag) as reader:
        player = Player(stop)
        recorded = {connection.topic for connection in reader.connections}
        topics = [
            topic if topic in recorded else player.expanded(topic) for topic in request.topics
        ]
        selection = select(
            bag, reader, topics, request.allow_valve_command, player.resolve_topic_name
        )
        for name, reason in selection.left_out.items():
            print(f"left out {name}: {reason}", flush=True)
        player.offer(selection.played)
        for topic in selection.played:
            print(f"playing {topic.name} ({topic.msgtype}, {topic.service})", flush=True)
        player.wait_for_subscribers(request.wait_for)
        _pass(player, bag, reader, selection, request.rate)
        while request.loop and not stop.requested:
            _pass(player, bag, reader, selection, request.rate)
        player.finish()
        if stop.requested:
            raise KeyboardInterrupt


def _pass(player: Player, bag: Path, reader: Reader, selection: Selection, rate: float) -> None:
    delays: list[int] = []
    seconds = reader.duration / NANOSECONDS
    with progress_bar(f"playing {bag.name}", seconds, form=SECONDS_BAR) as progress:

        def played(time: int, delay: int) -> None:
            delays.append(delay)
            progress.update((time - reader.start_time) / NANOSECONDS - progress.n)

        player.play(schedule(bag, reader, selection), rate, played)
    if delays:
        median, most, largest = np.percentile(delays, [50, 99, 100]) * 1e-6
        print(
            f"{bag}: {len(delays)} messages played, behind by {median:.1f} ms (median), "
            f"{most:.1f} ms (99 %), {largest:.1f} ms (largest)",
            flush=True,
        )


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="player",
        description="Plays a bag (mcap or sqlite3) at its recorded rate, with the time of the "
        "bag on /clock. Header stamps are as recorded.",
        epilog="ROS arguments follow --ros-args. Valve commands can be looked at under another "
        "name: --ros-args -r /valve_command:=/recorded_command",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="bag: a folder, or one of its files")
    parser.add_argument(
        "--rate", type=above(0.0), default=1.0, metavar="R", help="factor of the speed (default: 1)"
    )
    parser.add_argument(
        "--topics", nargs="+", default=(), metavar="TOPIC", help="topics to play (default: all)"
    )
    parser.add_argument("--loop", action="store_true", help="repeat the bag without end")
    parser.add_argument(
        "--wait-for",
        nargs="+",
        default=(),
        metavar="TOPIC",
        help="topics that need a subscriber before the start",
    )
    parser.add_argument(
        "--allow-valve-command",
        action="store_true",
        help="also play /valve_command: THIS MOVES A CRANE whose driver listens",
    )
    return parser
