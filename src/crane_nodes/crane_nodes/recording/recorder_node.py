"""`ros2 run crane_nodes recorder`: topics into a bag, until Ctrl-C.

The node finds publishers, records their messages, and reports on /diagnostics.
"""

import argparse
import math
import struct
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock as SteadyClock
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_hash import TypeHash
from rosgraph_msgs.msg import Clock

from crane_bags.clocks import NANOSECONDS
from crane_bags.types import TOPICS, typestore
from crane_model.cli import above, command_line, run
from crane_model.errors import DataError
from crane_nodes.executor import KeptExecutor, Polled
from crane_nodes.managed import NameLooks, full_name, node_names, own_arguments, ros, say_ready
from crane_nodes.node_time import CLOCK_TOPIC, NodeTime, Pacing, nanoseconds
from crane_nodes.recording.bag import (
    RecordedBag,
    RecordedTopic,
    Split,
    installed_definition,
    message_class,
)
from crane_nodes.recording.ros import WAITING_MESSAGES, Service, offered, profile, request
from crane_nodes.recording.statistics import Arrivals, Rhythm, Silence, Span, shown, table

VISIT_PERIOD_S = 0.05  # between two visits to the queues of the subscriptions
FLUSH_PERIOD_S = 0.5  # what is younger is lost when the process is killed
REPORT_PERIOD_S = 1.0
AHEAD_S = 1.0  # s, by which simulated time may be ahead of what was recorded
CLOCK_QOS = QoSProfile(depth=2000)  # messages of /clock

NAMES = tuple(topic.relative for topic in TOPICS)
MEGABYTE_BYTES = 1_000_000
HEADER_TYPE = "std_msgs/Header"
STAMP_FORMATS = (">iI", "<iI")  # seconds and nanoseconds, by the byte order that CDR states
ORDER_BYTE, STAMP_BYTE = 1, 4  # of a message, where the order stands and the stamp of a header


class Early(NamedTuple):
    """A subscription before there is a publisher, so that none of its messages is missed."""

    msgtype: str
    service: Service
    messages: Polled


@dataclass
class Recorded:
    """A topic that is being recorded."""

    topic: RecordedTopic
    number: int  # in the bag
    messages: Polled
    service: Service
    arrivals: Arrivals
    silence: Silence
    stamped: bool  # its messages begin with a header


class Recorder(Node):
    """Records `topics` to `bag` as their publishers come."""

    def __init__(self, bag: RecordedBag, topics: Sequence[str]):
        super().__init__("recorder")
        typestore()  # loaded now; later the first messages would have to wait for it
        self.topics = list(dict.fromkeys(map(self.resolve_topic_name, topics)))
        self.recorded: dict[str, Recorded] = {}
        self.problems: dict[str, str] = {}  # of a topic
        self._looks = NameLooks()
        self._bag = bag
        self._time = NodeTime(self)
        self._pacing = Pacing(self, self._time, AHEAD_S)
        self._ticks = Polled(self, Clock, CLOCK_TOPIC, CLOCK_QOS) if self._time.simulated else None
        self._early = self._expected()
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = SteadyClock(clock_type=ClockType.STEADY_TIME)
        for period, work in (
            (VISIT_PERIOD_S, self.visit),
            (FLUSH_PERIOD_S, bag.flush),
            (REPORT_PERIOD_S, self._report),
        ):
            self.create_timer(period, work, clock=steady)
        say_ready(self)

    def visit(self) -> None:
        self._search()
        self._take()

    def _take(self) -> None:
        arrived: list[tuple[int, bytes, dict[str, Any], Recorded]] = []
        for recorded in self.recorded.values():
            received = 0
            for data, info in recorded.messages.take():
                # Other middleware than Fast DDS may not stamp. Messages are handed out in
                # order: one that waited for a lost one before it is as late as that one.
                received = max(received, info["received_timestamp"] or time.time_ns())
                arrived.append((received, data, info, recorded))
        arrived.sort(key=lambda message: message[0])
        ticks = deque(self._ticks.take()) if self._ticks else deque()
        for received, data, info, recorded in arrived:
            while ticks and ticks[0][1]["received_timestamp"] <= received:
                self._time.tell(ticks.popleft()[0])
            log_time = self._simulated(recorded, data) if self._time.simulated else received
            sequence = info["publication_sequence_number"]
            self._bag.write(
                recorded.number, log_time, data, info["source_timestamp"], sequence or 0
            )
            recorded.arrivals.arrived(sequence)
            if recorded.silence.since is not None:
                self.get_logger().info(f"{recorded.topic.name} comes again")
            recorded.silence.arrived(self._time.now())
        for tick, _ in ticks:
            self._time.tell(tick)
        self._pacing.taken()

    def _simulated(self, recorded: Recorded, data: bytes) -> int:
        """Simulated time [ns] at which a message is received: not before its stamp, though its
        tick of /clock may come later. Of a stamp that is farther ahead than simulated time can be,
        nothing is believed.
        """
        now = nanoseconds(self._time.stamp())
        if not recorded.stamped:
            return now
        seconds, rest = struct.unpack_from(STAMP_FORMATS[data[ORDER_BYTE] & 1], data, STAMP_BYTE)
        stamp = int(seconds * NANOSECONDS + rest)
        return stamp if 0 < stamp - now <= 2.0 * AHEAD_S * NANOSECONDS else now

    def _expected(self) -> dict[str, Early]:
        """Subscribe as the suite publishes; what others offer is seen when they come."""
        early = {}
        for topic in TOPICS:
            if (name := self.resolve_topic_name(topic.relative)) in self.topics:
                service = Service(reliable=True, latched=topic.latched, depth=WAITING_MESSAGES)
                messages = self._subscribe(name, topic.msgtype, service)
                early[name] = Early(topic.msgtype, service, messages)
        return early

    def _subscribe(self, name: str, msgtype: str, service: Service) -> Polled:
        return Polled(self, message_class(msgtype), name, profile(service), raw=True)

    def _search(self) -> None:
        for name in self.topics:
            if name in self.recorded or name in self.problems:
                continue
            if publishers := self.get_publishers_info_by_topic(name):
                try:
                    self._record(name, publishers)
                except DataError as error:
                    self._problem(name, f"not recorded: {error}")

    def _record(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        msgtype = publishers[0].topic_type
        same = [endpoint for endpoint in publishers if endpoint.topic_type == msgtype]
        definition = installed_definition(msgtype)
        announced = {str(endpoint.topic_type_hash) for endpoint in same} - {str(TypeHash())}
        if others := announced - {definition.type_hash}:
            self._problem(name, f"published with another definition of {msgtype} than installed")
            definition = replace(definition, type_hash=min(others))
        topic = RecordedTopic(
            name, msgtype, definition, tuple(offered(endpoint.qos_profile) for endpoint in same)
        )
        service = request(topic.offered_qos)
        early = self._early.pop(name, None)
        if early and (early.msgtype, early.service) == (msgtype, service):
            messages = early.messages
        else:
            if early:
                early.messages.close()
            messages = self._subscribe(name, msgtype, service)
        arrivals = Arrivals(len(same), time.monotonic())
        silence = Silence(_rhythm(name, service))
        number = self._bag.add(topic)
        fields = message_class(msgtype).get_fields_and_field_types().values()
        self.recorded[name] = Recorded(
            topic, number, messages, service, arrivals, silence, HEADER_TYPE in [*fields][:1]
        )
        print(f"recording {name} ({msgtype}, {service})", flush=True)

    def _report(self) -> None:
        """Look at the publishers again, and publish how it goes."""
        self._take()  # before it is judged what has not come
        for name, recorded in self.recorded.items():
            publishers = self.get_publishers_info_by_topic(name)
            same = [
                endpoint for endpoint in publishers if endpoint.topic_type == recorded.topic.msgtype
            ]
            recorded.arrivals.published_by(len(same))
            recorded.arrivals.measure(time.monotonic())
            heard = [
                endpoint
                for endpoint in same
                if recorded.service.hears(offered(endpoint.qos_profile))
            ]
            unheard = node_names(endpoint for endpoint in publishers if endpoint not in heard)
            if unheard and self._looks.suffice(name, unheard):
                self._problem(
                    name,
                    f"not recorded from {', '.join(unheard)}: type or quality of service "
                    "differ from those of its first publisher; start both before the recorder",
                )
            self._listen(name, recorded, heard)
        message = DiagnosticArray(status=[self._status()])
        message.header.stamp = self._time.stamp()
        self._diagnostics.publish(message)

    def _listen(self, name: str, recorded: Recorded, heard: Sequence[TopicEndpointInfo]) -> None:
        """Say at once when a topic falls silent."""
        silence, now = recorded.silence, self._time.now()
        before = silence.since
        silence.look(len(heard), now)
        if before is None and silence.since is not None:
            self.get_logger().warning(
                f"{name}: nothing has come since {self._utc(silence.since)}, though it has a "
                f"publisher ({', '.join(node_names(heard))}); see its log and "
                "/diagnostics. If others hear it, start the recorder again"
            )

    def silences(self) -> dict[str, str]:
        """Report each topic that was silent though it had a publisher."""
        now = self._time.now()
        spans = {name: recorded.silence.spans(now) for name, recorded in self.recorded.items()}
        return {name: self._told(found) for name, found in spans.items() if found}

    def _status(self) -> DiagnosticStatus:
        arrivals = {name: recorded.arrivals for name, recorded in self.recorded.items()}
        status = DiagnosticStatus(name=f"{full_name(self)}: {self._bag.path.name}")
        lost = sum(topic_arrivals.lost or 0 for topic_arrivals in arrivals.values())
        if self.problems:
            status.level = DiagnosticStatus.ERROR
            status.message = "; ".join(f"{name} {text}" for name, text in self.problems.items())
        elif warnings := [*self._silent(), *[f"{lost} messages lost"] * bool(lost)]:
            status.level = DiagnosticStatus.WARN
            status.message = "; ".join(warnings)
        else:
            status.level = DiagnosticStatus.OK
            status.message = f"recording {len(arrivals)} of {len(self.topics)} topics"
        for name, arrivals_of_topic in arrivals.items():
            for quantity, value in (
                ("rate [Hz]", f"{arrivals_of_topic.rate:.1f}"),
                ("messages", str(arrivals_of_topic.count)),
                ("lost", shown(arrivals_of_topic.lost)),
            ):
                status.values.append(KeyValue(key=f"{name} {quantity}", value=value))
        for name, text in self.silences().items():
            status.values.append(KeyValue(key=f"{name} silent", value=text))
        return status

    def _silent(self) -> list[str]:
        return [
            f"{name} silent since {self._utc(recorded.silence.since)}, though it has a publisher"
            for name, recorded in self.recorded.items()
            if recorded.silence.since is not None
        ]

    def _told(self, spans: Sequence[Span]) -> str:
        longest = max(spans, key=lambda span: span.seconds)
        text = f"{longest.seconds:.1f} s from {self._utc(longest.begin)} on"
        if len(spans) == 1:
            return text
        total = sum(span.seconds for span in spans)
        return f"{total:.1f} s in {len(spans)} silences, the longest {text}"

    def _utc(self, then: float) -> str:
        """When it was `then` by the clock of the node [s]."""
        now = nanoseconds(self._time.stamp()) / NANOSECONDS
        at = datetime.fromtimestamp(now - self._time.now() + then, UTC)
        return at.strftime("%Y-%m-%dT%H:%M:%SZ")

    def _problem(self, name: str, text: str) -> None:
        if name not in self.problems:
            self.problems[name] = text
            self.get_logger().warning(f"{name} {text}")


def _rhythm(name: str, service: Service) -> Rhythm:
    """Expected rhythm of a topic; one of the suite is known in every namespace."""
    base = name.rpartition("/")[2]
    known = [topic for topic in TOPICS if topic.name == f"/{base}"]
    if known:
        return Rhythm.CONTINUOUS if known[0].continuous else Rhythm.ANY
    return Rhythm.ANY if service.latched else Rhythm.UNKNOWN


def main(argv: Sequence[str] | None = None) -> int:
    """Record until SIGINT, SIGTERM or SIGHUP."""
    argv = sys.argv[1:] if argv is None else argv
    options = _parser().parse_args(own_arguments(argv))
    split = Split(options.split_size * MEGABYTE_BYTES, options.split_seconds)
    return run(lambda: _record(argv, options.out, options.topics, split))


def _record(argv: Sequence[str], out: Path, topics: Sequence[str], split: Split) -> None:
    with ros(argv) as stop:
        with RecordedBag(out, split) as bag:
            recorder = Recorder(bag, topics)
            executor = KeptExecutor()
            executor.add_node(recorder)
            while not stop.requested:
                executor.spin_once(timeout_sec=0.1)
            recorder.visit()
            silences = recorder.silences()
            bag.remarks |= {f"silent {name}": text for name, text in silences.items()}
        print(_summary(bag, recorder), flush=True)


def _summary(bag: RecordedBag, recorder: Recorder) -> str:
    rows = []
    for name in recorder.topics:
        if name in recorder.recorded:
            recorded = recorder.recorded[name]
            arrivals = recorded.arrivals
            rows.append((name, recorded.topic.msgtype, str(arrivals.count), shown(arrivals.lost)))
        else:
            rows.append(
                (name, "not recorded" if name in recorder.problems else "no publisher", "0", "")
            )
    lines = [
        table(("topic", "type", "messages", "lost"), rows),
        *(f"{topic}: {text}, though it had a publisher" for topic, text in bag.remarks.items()),
        f"{bag.path}: {sum(bag.counts)} messages",
    ]
    return "\n".join(lines)


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="recorder",
        description="Records topics to an mcap bag until Ctrl-C.",
        epilog="ROS arguments follow --ros-args, for example -p use_sim_time:=true for a bag of "
        "simulated time. A bag whose recorder was killed is repaired by: "
        "ros2 run crane_nodes recover BAG --out NEW",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="BAG", help="new folder of the bag"
    )
    parser.add_argument(
        "--topics", nargs="+", default=NAMES, metavar="TOPIC", help=f"default: {' '.join(NAMES)}"
    )
    parser.add_argument(
        "--split-size",
        type=above(0.0),
        default=math.inf,
        metavar="MB",
        help="size at which a new file begins [10^6 bytes]",
    )
    parser.add_argument(
        "--split-seconds",
        type=above(0.0),
        default=math.inf,
        metavar="S",
        help="duration after which a new file begins [s]",
    )
    return parser
