"""The recorder as a node: finds publishers, takes what they send, and says how it goes."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
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
from crane_model.errors import DataError
from crane_nodes.managed import say_ready
from crane_nodes.names import NameLooks, full_name, node_names
from crane_nodes.node_time import CLOCK_TOPIC, NodeTime, Pacing, nanoseconds
from crane_nodes.polled import Polled
from crane_nodes.recording.bag import (
    RecordedBag,
    RecordedTopic,
    installed_definition,
    message_class,
)
from crane_nodes.recording.ros import DEPTH, Service, offered, profile, request
from crane_nodes.recording.statistics import (
    Arrivals,
    Rhythm,
    Silence,
    Span,
    shown,
)

VISIT_PERIOD_S = 0.05  # between two visits to the queues of the subscriptions
FLUSH_PERIOD_S = 0.5  # what is younger is lost when the process is killed
REPORT_PERIOD_S = 1.0
AHEAD = 1.0  # s, by which simulated time may be ahead of what was recorded
TICKS = QoSProfile(depth=2000)  # messages of /clock


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
        self._pacing = Pacing(self, self._time, AHEAD)
        self._ticks = Polled(self, Clock, CLOCK_TOPIC, TICKS) if self._time.simulated else None
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
        """Look for new publishers, and write what has arrived since the last call."""
        self._search()
        self._take()

    def _take(self) -> None:
        """In the order of reception."""
        arrived: list[tuple[int, bytes, dict[str, Any], Recorded]] = []
        for recorded in self.recorded.values():
            for data, info in recorded.messages.take():
                # other middleware than Fast DDS may not stamp
                arrived.append((info["received_timestamp"] or time.time_ns(), data, info, recorded))
        arrived.sort(key=lambda one: one[0])
        ticks = deque(self._ticks.take()) if self._ticks else deque()
        for received, data, info, recorded in arrived:
            while ticks and ticks[0][1]["received_timestamp"] <= received:
                self._time.tell(ticks.popleft()[0])
            log_time = nanoseconds(self._time.stamp()) if self._time.simulated else received
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

    def _expected(self) -> dict[str, Early]:
        """Subscribe as the suite publishes; what others offer is seen when they come."""
        early = {}
        for topic in TOPICS:
            if (name := self.resolve_topic_name(topic.relative)) in self.topics:
                service = Service(reliable=True, latched=topic.latched, depth=DEPTH)
                messages = self._subscribe(name, topic.msgtype, service)
                early[name] = Early(topic.msgtype, service, messages)
        return early

    def _subscribe(self, name: str, msgtype: str, service: Service) -> Polled:
        return Polled(self, message_class(msgtype), name, profile(service), raw=True)

    def _search(self) -> None:
        """Record the topics that have got publishers."""
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
        same = [one for one in publishers if one.topic_type == msgtype]
        definition = installed_definition(msgtype)
        announced = {str(one.topic_type_hash) for one in same} - {str(TypeHash())}
        if others := announced - {definition.type_hash}:
            self._problem(name, f"published with another definition of {msgtype} than installed")
            definition = replace(definition, type_hash=min(others))
        topic = RecordedTopic(
            name, msgtype, definition, tuple(offered(one.qos_profile) for one in same)
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
        self.recorded[name] = Recorded(topic, number, messages, service, arrivals, silence)
        print(f"recording {name} ({msgtype}, {service})", flush=True)

    def _report(self) -> None:
        """Look at the publishers again, and publish how it goes."""
        self._take()  # before it is judged what has not come
        for name, recorded in self.recorded.items():
            publishers = self.get_publishers_info_by_topic(name)
            same = [one for one in publishers if one.topic_type == recorded.topic.msgtype]
            recorded.arrivals.published_by(len(same))
            recorded.arrivals.measure(time.monotonic())
            heard = [one for one in same if recorded.service.hears(offered(one.qos_profile))]
            unheard = node_names(one for one in publishers if one not in heard)
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
        """What is to be said of each topic that was silent though it had a publisher."""
        now = self._time.now()
        spans = {name: recorded.silence.spans(now) for name, recorded in self.recorded.items()}
        return {name: self._told(found) for name, found in spans.items() if found}

    def _status(self) -> DiagnosticStatus:
        arrivals = {name: recorded.arrivals for name, recorded in self.recorded.items()}
        status = DiagnosticStatus(name=f"{full_name(self)}: {self._bag.path.name}")
        lost = sum(one.lost or 0 for one in arrivals.values())
        if self.problems:
            status.level = DiagnosticStatus.ERROR
            status.message = "; ".join(f"{name} {text}" for name, text in self.problems.items())
        elif warnings := [*self._silent(), *[f"{lost} messages lost"] * bool(lost)]:
            status.level = DiagnosticStatus.WARN
            status.message = "; ".join(warnings)
        else:
            status.level = DiagnosticStatus.OK
            status.message = f"recording {len(arrivals)} of {len(self.topics)} topics"
        for name, one in arrivals.items():
            for quantity, value in (
                ("rate [Hz]", f"{one.rate:.1f}"),
                ("messages", str(one.count)),
                ("lost", shown(one.lost)),
            ):
                status.values.append(KeyValue(key=f"{name} {quantity}", value=value))
        for name, text in self.silences().items():
            status.values.append(KeyValue(key=f"{name} silent", value=text))
        return status

    def _silent(self) -> list[str]:
        return [
            f"{name} silent since {self._utc(one.silence.since)}, though it has a publisher"
            for name, one in self.recorded.items()
            if one.silence.since is not None
        ]

    def _told(self, spans: Sequence[Span]) -> str:
        longest = max(spans, key=lambda one: one.seconds)
        text = f"{longest.seconds:.1f} s from {self._utc(longest.begin)} on"
        if len(spans) == 1:
            return text
        total = sum(one.seconds for one in spans)
        return f"{total:.1f} s in {len(spans)} silences, the longest {text}"

    def _utc(self, then: float) -> str:
        """When it was `then` by the clock of the node [s]."""
        now = nanoseconds(self._time.stamp()) / NANOSECONDS
        at = datetime.fromtimestamp(now - self._time.now() + then, UTC)
        return at.strftime("%Y-%m-%dT%H:%M:%SZ")

    def _problem(self, name: str, text: str) -> None:
        """Say once what is wrong with a topic."""
        if name not in self.problems:
            self.problems[name] = text
            self.get_logger().warning(f"{name} {text}")


def _rhythm(name: str, service: Service) -> Rhythm:
    """What is expected of a topic; one of the suite is known in every namespace."""
    base = name.rpartition("/")[2]
    known = [one for one in TOPICS if one.name == f"/{base}"]
    if known:
        return Rhythm.CONTINUOUS if known[0].continuous else Rhythm.ANY
    return Rhythm.ANY if service.latched else Rhythm.UNKNOWN
