"""The player as a process on a real ROS graph: what was recorded, in its rhythm, and no valve."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from integration.recording_graph import LATCHED, Graph
from laboratory_crane import JOINTS, PLANAR_JOINTS
from rclpy.qos import QoSProfile
from rosbags.rosbag2 import StoragePlugin, Writer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from crane_bags import BagWriter, read_topics, typestore
from crane_bags.storage import open_bag
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, ROBOT_DESCRIPTION, VALVE_COMMAND
from crane_bags.writer import offered_qos
from crane_interfaces.msg import CylinderPressures, ValveCommand

STEP = 5_000_000  # ns
START = 1_700_000_000_000_000_000  # ns, of the bag
COUNT = 300
TRIES = 3
DEEP = QoSProfile(depth=10 * COUNT)
CLASSES = {
    JOINT_STATES.name: JointState,
    CYLINDER_PRESSURES.name: CylinderPressures,
    VALVE_COMMAND.name: ValveCommand,
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """1.5 s of a crane: three topics at 200 Hz and its description; stamps are 1 ms before."""
    path = tmp_path_factory.mktemp("bags") / "bag"
    values = np.random.default_rng(0).normal(size=(COUNT, 3, 4))
    with BagWriter(path) as writer:
        description = writer.add(ROBOT_DESCRIPTION)
        text = writer.store.types[ROBOT_DESCRIPTION.msgtype](data="<robot/>")
        description.write(START, text)
        states = writer.add_arrays(JOINT_STATES, JOINTS)
        pressures = writer.add_arrays(CYLINDER_PRESSURES, PLANAR_JOINTS)
        commands = writer.add_arrays(VALVE_COMMAND, JOINTS)
        for k, (position, velocity, effort) in enumerate(values):
            time = START + k * STEP
            states.write(time, time - 1_000_000, position, velocity, effort)
            pressures.write(time + 1, time - 1_000_000, position[1:], velocity[1:], 2e7, np.nan)
            commands.write(time + 2, time - 1_000_000, position / 10)
    return path


class Listener:
    """Everything that arrives on a topic, and when it was sent [ns]."""

    def __init__(self, ros: Graph, topic: str, kind: type, qos: QoSProfile = DEEP):
        self.messages: list[Any] = []
        self.sent: list[int] = []
        self.subscription = ros.node.create_subscription(kind, topic, self._take, qos)

    def _take(self, message: Any, info: dict[str, int]) -> None:
        self.messages.append(message)
        self.sent.append(info["source_timestamp"])

    @property
    def stamps(self) -> list[int]:
        stamps = [one.header.stamp for one in self.messages]
        return [one.sec * 10**9 + one.nanosec for one in stamps]

    @property
    def times(self) -> list[int]:
        return [one.clock.sec * 10**9 + one.clock.nanosec for one in self.messages]


def listen(ros: Graph) -> dict[str, Listener]:
    return {topic: Listener(ros, topic, kind) for topic, kind in CLASSES.items()}


def test_everything_is_played_in_order_but_the_valves(ros: Graph, bag: Path) -> None:
    """Subscribers that come after the player miss nothing if it waits for them."""
    player = ros.start("player", bag, "--wait-for", "/joint_states", "cylinder_pressures")
    ros.wait(lambda: ros.node.count_publishers("/joint_states"))
    listeners = listen(ros)
    states, pressures = listeners["/joint_states"], listeners["/cylinder_pressures"]
    ros.wait(lambda: len(states.messages) == len(pressures.messages) == COUNT)
    assert ros.node.count_publishers("/valve_command") == 0
    ros.wait(lambda: not player.running)

    recorded = read_topics(bag, [JOINT_STATES, CYLINDER_PRESSURES])
    for topic, listener in (("/joint_states", states), ("/cylinder_pressures", pressures)):
        assert listener.stamps == recorded[topic].stamp.tolist()
    for name, values in recorded["/joint_states"].fields.items():
        np.testing.assert_array_equal([getattr(one, name) for one in states.messages], values)
    assert listeners["/valve_command"].messages == []
    assert "left out /valve_command: would move the crane; --allow-valve-command" in player.output
    assert "601 messages played" in player.output


def delays(rate: float, ros: Graph, bag: Path) -> np.ndarray:
    """How late each joint state of a bag that is played was sent [ns]."""
    states = Listener(ros, "/joint_states", JointState)
    clock = Listener(ros, "/clock", Clock)
    played = ("--topics", "/joint_states", "--wait-for", "/joint_states", "/clock")
    player = ros.start("player", bag, "--rate", rate, *played)
    ros.wait(lambda: len(states.messages) == COUNT)
    ros.wait(lambda: clock.times and clock.times[-1] > START + 0.9 * COUNT * STEP)
    begins = np.array(clock.sent) - (np.array(clock.times) - START) / rate  # each as late as it was
    assert clock.times == sorted(clock.times)
    assert clock.times[0] >= START
    ros.wait(lambda: not player.running)
    for one in (states, clock):
        ros.node.destroy_subscription(one.subscription)
    return np.array(states.sent) - begins.min() - np.arange(COUNT) * STEP / rate


@pytest.mark.parametrize("rate", [1.0, 2.0])
def test_rhythm_is_that_of_the_bag(rate: float, ros: Graph, bag: Path) -> None:
    """No message before its time, and none so late that the player had slowed down; a busy test
    machine may hold it up at the end, but hardly every time.
    """
    for _ in range(TRIES):
        late = delays(rate, ros, bag)
        assert late.min() > -1e6
        if late[-COUNT // 10 :].min() < 0.5e9:
            return
    pytest.fail(f"{late[-COUNT // 10 :].min() * 1e-9:.1f} s late at the end")


def test_late_subscriber_gets_the_latched_message(ros: Graph, bag: Path) -> None:
    player = ros.start("player", bag, "--loop", "--topics", "/robot_description", "/joint_states")
    states = Listener(ros, "/joint_states", JointState)
    ros.wait(lambda: len(states.messages) > 2 * COUNT)  # twice through the bag
    description = Listener(ros, "/robot_description", String, LATCHED)
    ros.wait(lambda: description.messages)
    assert description.messages[0].data == "<robot/>"
    assert player.end(signal.SIGINT) == 130
    assert "interrupted" in player.output


def test_valves_when_told(ros: Graph, bag: Path) -> None:
    commands = Listener(ros, "/valve_command", ValveCommand)
    arguments = ("--allow-valve-command", "--wait-for", "/valve_command")
    player = ros.start("player", bag, *arguments)
    ros.wait(lambda: len(commands.messages) == COUNT)
    ros.wait(lambda: not player.running)
    assert "left out" not in player.output


def test_valves_under_another_name(ros: Graph, bag: Path) -> None:
    """Nor does another topic reach them by the remapping of ROS."""
    commands = Listener(ros, "/valve_command", ValveCommand)
    recorded = Listener(ros, "/recorded_command", ValveCommand)
    renamed = ("-r", "/valve_command:=/recorded_command", "-r", "/joint_states:=/valve_command")
    player = ros.start("player", bag, "--wait-for", "/recorded_command", "--ros-args", *renamed)
    ros.wait(lambda: len(recorded.messages) == COUNT)
    ros.wait(lambda: not player.running)
    assert commands.messages == []
    assert "left out /joint_states: would move the crane" in player.output


@pytest.mark.parametrize("storage", StoragePlugin)
def test_bag_of_others(storage: StoragePlugin, ros: Graph, tmp_path: Path) -> None:
    """Of either storage, with topics that begin without a slash, in one file."""
    path, store = tmp_path / "theirs", typestore()
    with Writer(path, version=8, storage_plugin=storage) as writer:
        connection = writer.add_connection(
            "words",
            "std_msgs/msg/String",
            typestore=store,
            offered_qos_profiles=[offered_qos(JOINT_STATES)],
        )
        for k in range(20):
            message = store.types["std_msgs/msg/String"](data=f"word {k}")
            writer.write(connection, k, store.serialize_cdr(message, "std_msgs/msg/String"))
    (file,) = path.glob("theirs.*")
    for source in (path, file):
        words = Listener(ros, "/words", String)
        player = ros.start("player", source, "--wait-for", "/words")
        ros.wait(lambda: len(words.messages) == 20)  # noqa: B023
        ros.wait(lambda: not player.running)  # noqa: B023
        assert [one.data for one in words.messages] == [f"word {k}" for k in range(20)]
        ros.node.destroy_subscription(words.subscription)


def test_bag_of_rosbag2(ros: Graph, real_data: Path) -> None:
    """Five files of sqlite3 with eight topics."""
    path = real_data / "rosbag2_samples" / "sqlite3" / "wbag"
    words = Listener(ros, "/AAA", String)
    player = ros.start("player", path, "--rate", 1000, "--wait-for", "/AAA", "--topics", "AAA")
    ros.wait(lambda: not player.running)
    with open_bag(path) as reader:
        count = sum(one.msgcount for one in reader.connections if one.topic == "AAA")
    ros.wait(lambda: len(words.messages) == count)


def test_live_publisher_is_pointed_out(ros: Graph, bag: Path) -> None:
    ros.node.create_publisher(JointState, "/joint_states", 1)
    player = ros.start("player", bag, "--loop")
    ros.wait(lambda: "/joint_states is also published by test: subscribers get" in player.output)
    assert player.end(signal.SIGTERM) == 130


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--topics", "/tip"), "no topic /tip; the bag holds /cylinder_pressures, /joint_states"),
        (("--topics", "/valve_command"), "nothing to play (/valve_command: would move the crane"),
        (
            ("--wait-for", "/tip"),
            "cannot wait for subscribers of /tip: not played; played are /clock",
        ),
    ],
)
def test_what_cannot_be_done_is_said(
    arguments: tuple[str, ...], message: str, ros: Graph, bag: Path
) -> None:
    player = ros.start("player", bag, *arguments)
    assert player.process.wait() == 1
    assert message in player.output


def test_waiting_ends_with_a_signal(ros: Graph, bag: Path) -> None:
    player = ros.start("player", bag, "--wait-for", "/joint_states")
    ros.wait(lambda: ros.node.count_publishers("/joint_states"))
    assert player.end(signal.SIGTERM) == 130
    assert "messages played" not in player.output
