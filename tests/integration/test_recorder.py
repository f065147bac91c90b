"""The recorder as a process on a real ROS graph: nothing is lost, whatever ends it."""

import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from integration.processes import SIMULATED_TIME
from integration.recording_graph import LATCHED, Graph, Process, Source, graph
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from crane_bags import read_topics
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
)
from crane_model import DataError
from crane_nodes.node_time import TAKEN_PROFILE, stamp_of
from crane_nodes.recording.statistics import SHORTEST_SILENCE_S

TOPICS = (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)
SECOND = 1_000_000_000  # ns
TRIES = 3


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return tmp_path / "bag"


def stored(bag: Path) -> dict[str, tuple[Qos, ...]]:
    """Topics and the QoS profiles that their publishers offered."""
    with Reader(bag) as reader:
        return {one.topic: tuple(one.ext.offered_qos_profiles) for one in reader.connections}


def stamps(bag: Path) -> dict[str, list[int]]:
    """Header stamps of the four topics."""
    data = read_topics(bag, TOPICS)
    return {name: one.stamp.tolist() for name, one in data.items()}


def states_of(path: Path) -> list[int]:
    """Header stamps of the joint states in one file, which may have none."""
    data = read_topics(path, [], [JOINT_STATES])
    return data[JOINT_STATES.name].stamp.tolist() if data else []


def begun(ros: Graph, source: Source, recorder: Process) -> None:
    """Wait until publishers and recorder have found each other, both ways."""
    source.wait_for_subscribers()
    ros.wait(lambda: all(f"recording {name} " in recorder.output for name in source.publishers))


class Health:
    """What the recorder tells about itself on /diagnostics."""

    def __init__(self, ros: Graph):
        self.status = DiagnosticStatus(level=DiagnosticStatus.STALE)
        self.rates: list[str] = []  # of the joint states
        ros.node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)

    def _take(self, message: DiagnosticArray) -> None:
        (self.status,) = message.status
        self.rates.append(self.value("/joint_states rate [Hz]") or "0")

    def value(self, key: str) -> str | None:
        return next((one.value for one in self.status.values if one.key == key), None)

    def messages(self, topic: str) -> int:
        return int(self.value(f"{topic} messages") or 0)


def test_no_message_is_lost(ros: Graph, bag: Path) -> None:
    """At 200 Hz on four topics over ten seconds; SIGTERM leaves a bag that every reader opens."""
    source = Source(ros)
    recorder = ros.start("recorder", "--out", bag)
    begun(ros, source, recorder)
    source.send(2000)
    source.wait_until_received()
    assert recorder.end(signal.SIGTERM) == 0
    ended = time.time_ns()

    assert stamps(bag) == {topic.name: source.stamps for topic in TOPICS}
    for topic in TOPICS:
        assert f"recording {topic.name} ({topic.msgtype}, reliable)" in recorder.output
        (row,) = (row for row in recorder.output.splitlines() if row.startswith(f"{topic.name} "))
        assert row.split() == [topic.name, topic.msgtype, "2000", "0"]
    with Reader(bag) as reader:
        states = [one for one in reader.connections if one.topic == JOINT_STATES.name]
        received = np.array([log_time for _, log_time, _ in reader.messages(states)])
        (publisher,) = ros.node.get_publishers_info_by_topic(JOINT_STATES.name)
        assert states[0].digest == str(publisher.topic_type_hash)
    delay = received - np.array(source.stamps)
    assert delay.min() > 0
    assert received.max() <= ended


def test_latched_and_best_effort_topics(ros: Graph, bag: Path) -> None:
    """Published before the recorder was there, or by one who promises nothing."""
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    description = ros.node.create_publisher(String, "/robot_description", LATCHED)
    states = ros.node.create_publisher(JointState, "/joint_states", best_effort)
    description.publish(String(data="<robot/>"))
    health = Health(ros)
    recorder = ros.start("recorder", "--out", bag, "--topics", "robot_description", "joint_states")
    ros.wait(states.get_subscription_count)
    states.publish(JointState(name=["slew"], position=[0.5]))
    ros.wait(lambda: health.messages("/robot_description") == health.messages("/joint_states") == 1)
    assert recorder.end(signal.SIGINT) == 0

    qos = stored(bag)
    assert [one.durability for one in qos["/robot_description"]] == [QosDurability.TRANSIENT_LOCAL]
    assert [one.reliability for one in qos["/joint_states"]] == [QosReliability.BEST_EFFORT]
    assert read_topics(bag, [JOINT_STATES])["/joint_states"].fields["position"].tolist() == [[0.5]]


def test_no_message_is_logged_before_its_stamp(ros: Graph, bag: Path) -> None:
    """Its tick of /clock may come later; a stamp far ahead is not believed."""
    clock = ros.node.create_publisher(Clock, "/clock", 10)
    states = ros.node.create_publisher(JointState, "/joint_states", 10)
    taken: list[Header] = []
    ros.node.create_subscription(Header, "/lock_step", taken.append, TAKEN_PROFILE)
    health = Health(ros)
    arguments = ("--out", bag, "--topics", "joint_states", "--ros-args", *SIMULATED_TIME)
    recorder = ros.start("recorder", *arguments)
    ros.wait(lambda: clock.get_subscription_count() and states.get_subscription_count())
    clock.publish(Clock(clock=stamp_of(10 * SECOND)))
    ros.wait(lambda: taken and taken[-1].stamp.sec == 11)
    for stamp in (10 * SECOND + SECOND // 2, 99 * SECOND):
        header = Header(stamp=stamp_of(stamp))
        states.publish(JointState(header=header, name=["slew"], position=[0.5]))
    ros.wait(lambda: health.messages("/joint_states") == 2)
    assert recorder.end(signal.SIGTERM) == 0
    with Reader(bag) as reader:
        received = [log_time for _, log_time, _ in reader.messages()]
    assert received == [10 * SECOND, 10 * SECOND + SECOND // 2]


def lost_by_kill(ros: Graph, source: Source, bag: Path, mended: Path) -> int:
    """Since when before its end a recorder that is killed has lost messages [ns]; the bag is
    mended.
    """
    publishers = source.publishers.values()
    ros.wait(lambda: not any(one.get_subscription_count() for one in publishers))  # of one before
    source.stamps.clear()
    recorder = ros.start("recorder", "--out", bag)
    begun(ros, source, recorder)
    source.send(700)
    killed = time.time_ns()
    assert recorder.end(signal.SIGKILL) == -signal.SIGKILL
    before = {file.name: file.read_bytes() for file in bag.iterdir()}
    with pytest.raises(DataError, match=f"repair it: ros2 run crane_nodes recover {bag} --out"):
        stamps(bag)

    recover = ros.start("recover", bag, "--out", mended)
    assert recover.end() == 0, recover.output
    ros.processes.clear()
    saved = stamps(mended)
    for topic in TOPICS:
        assert saved[topic.name] == source.stamps[: len(saved[topic.name])]
        assert f"{topic.name} " in recover.output
    assert "/robot_description" in stored(mended)
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before
    lost = source.stamps[min(len(one) for one in saved.values()) :]
    return killed - lost[0] if lost else 0


def test_kill_loses_at_most_the_last_second(ros: Graph, tmp_path: Path) -> None:
    """Unless a busy test machine has held up the recorder just then, but hardly every time."""
    source = Source(ros)
    lost = []
    for k in range(TRIES):
        lost.append(lost_by_kill(ros, source, tmp_path / f"bag_{k}", tmp_path / f"mended_{k}"))
        if lost[-1] < SECOND:
            return
    pytest.fail(f"lost the last {lost} ns")


def test_split_files(ros: Graph, bag: Path) -> None:
    source = Source(ros)
    recorder = ros.start("recorder", "--out", bag, "--split-seconds", 0.5)
    begun(ros, source, recorder)
    source.send(400)
    source.wait_until_received()
    assert recorder.end(signal.SIGTERM) == 0

    files = [f"bag_{k}.mcap" for k in range(len(list(bag.glob("*.mcap"))))]
    assert len(files) >= 4
    assert set(files) == {file.name for file in bag.glob("*.mcap")}
    assert stamps(bag) == {topic.name: source.stamps for topic in TOPICS}
    states = [k for file in files for k in states_of(bag / file)]
    assert states == source.stamps


def test_impatient_user_does_not_damage_the_bag(ros: Graph, bag: Path) -> None:
    """Nor lose anything: messages with the publisher's first breath, then Ctrl-C, again and again,
    and a hang-up.
    """
    recorder = ros.start("recorder", "--out", bag)
    ros.wait(lambda: all(ros.node.count_subscribers(topic.name) for topic in TOPICS))
    source = Source(ros)
    source.send(5)  # less than what the publisher keeps for a slow subscriber
    source.wait_until_received()
    assert recorder.end(signal.SIGINT, signal.SIGINT, signal.SIGHUP, signal.SIGINT) == 0
    assert stamps(bag) == {topic.name: source.stamps for topic in TOPICS}


def test_diagnostics_tell_how_it_goes(ros: Graph, bag: Path) -> None:
    source, health = Source(ros), Health(ros)
    recorder = ros.start("recorder", "--out", bag)
    begun(ros, source, recorder)
    source.send(300)
    ros.wait(lambda: all(health.messages(topic) == 300 for topic in source.publishers))
    assert health.status.level == DiagnosticStatus.OK
    assert health.status.name == "recorder: bag"
    assert health.status.message == "recording 6 of 13 topics"
    assert health.value("/joint_states lost") == "0"
    sending = (source.stamps[-1] - source.stamps[0]) / SECOND  # s, parts of it in two reports
    assert max(float(rate) for rate in health.rates) > 0.5 * 300 / (sending + 2.0)
    assert recorder.end(signal.SIGTERM) == 0


def test_the_silence_of_a_topic_that_has_a_publisher_is_named(ros: Graph, bag: Path) -> None:
    """While it lasts, when it has ended, in the summary and in the bag; a latched topic, and one of
    events, have said what they had to.
    """
    states = ros.node.create_publisher(JointState, "/joint_states", 1)
    events = ros.node.create_publisher(String, "/events", 1)
    description = ros.node.create_publisher(String, "/robot_description", LATCHED)
    description.publish(String(data="<robot/>"))
    health = Health(ros)
    topics = ("/joint_states", "/events", "/robot_description")
    recorder = ros.start("recorder", "--out", bag, "--topics", *topics)
    ros.wait(events.get_subscription_count)
    events.publish(String(data="begun"))
    ros.wait(lambda: "/joint_states silent since" in health.status.message)
    assert health.status.level == DiagnosticStatus.WARN
    assert "/joint_states: nothing has come since 20" in recorder.output
    assert "it has a publisher (" in recorder.output
    states.publish(JointState(name=["slew"], position=[0.5]))
    ros.wait(lambda: health.status.level == DiagnosticStatus.OK)
    assert float((health.value("/joint_states silent") or "0").split()[0]) >= SHORTEST_SILENCE_S
    assert recorder.end(signal.SIGTERM) == 0

    (said,) = (line for line in recorder.output.splitlines() if line.startswith("silent "))
    assert said.startswith("silent /joint_states: ")
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    (remark,) = content["rosbag2_bagfile_information"]["custom_data"].items()
    assert f"{remark[0]}: {remark[1]}, though it had a publisher" == said


def test_publishers_that_cannot_be_recorded_are_named(
    ros: Graph, bag: Path, ros_domain: int, tmp_path: Path
) -> None:
    """A second publisher of another type, and one that promises less than the first."""
    health = Health(ros)
    strings = ros.node.create_publisher(String, "/mixed", 1)
    states = ros.node.create_publisher(JointState, "/joint_states", 1)
    recorder = ros.start("recorder", "--out", bag, "--topics", "/mixed", "/joint_states")
    ros.wait(strings.get_subscription_count)
    ros.wait(states.get_subscription_count)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    with graph(ros_domain, tmp_path) as late:
        late.node.create_publisher(Header, "/mixed", 1)
        late.node.create_publisher(JointState, "/joint_states", best_effort)
        ros.wait(
            lambda: health.status.message.count("not recorded from test: type or quality") == 2
        )
    assert health.status.level == DiagnosticStatus.ERROR
    assert health.value("/joint_states lost") == "unknown"
    assert recorder.output.count("not recorded from test: type or quality of service") == 2
    assert recorder.end(signal.SIGTERM) == 0


def test_full_disk_ends_the_recording(ros: Graph, bag: Path, tmp_path: Path) -> None:
    """With an error that names the remedy, which works."""
    source = Source(ros)
    recorder = ros.start("recorder", "--out", bag)
    begun(ros, source, recorder)
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (200_000, 200_000))
    while recorder.running:
        source.send(20)
    assert recorder.end() == 1
    assert f"error: {bag}: cannot write: File too large; make room, then repair" in recorder.output
    ros.processes.clear()
    mended = tmp_path / "mended"
    assert ros.start("recover", bag, "--out", mended).end() == 0
    saved = stamps(mended)[JOINT_STATES.name]
    assert len(saved) > 100
    assert saved == source.stamps[: len(saved)]


def test_folder_that_exists_is_refused(ros: Graph, bag: Path) -> None:
    bag.mkdir()
    recorder = ros.start("recorder", "--out", bag)
    assert recorder.process.wait() == 1
    assert f"error: {bag}: cannot make a bag here: File exists" in recorder.output
