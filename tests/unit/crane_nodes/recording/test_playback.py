"""What of a bag is played onto which topic, and when."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer

from crane_bags import Topic, typestore
from crane_bags.storage import open_bag
from crane_bags.types import JOINT_STATES, ROBOT_DESCRIPTION, VALVE_COMMAND
from crane_bags.writer import offered_qos
from crane_model import DataError
from crane_nodes.recording.bag import RecordedBag, RecordedTopic, installed_definition
from crane_nodes.recording.player_node import PlaybackPace, Selection, schedule, select

CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock")
TOPICS = (JOINT_STATES, VALVE_COMMAND, ROBOT_DESCRIPTION, CLOCK)


@pytest.fixture(params=StoragePlugin)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Two messages of each topic, one after the other."""
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=request.param) as writer:
        channels = [
            writer.add_connection(
                topic.name,
                topic.msgtype,
                typestore=typestore(),
                offered_qos_profiles=[offered_qos(topic)],
            )
            for topic in TOPICS
        ]
        for k in range(2 * len(TOPICS)):
            writer.write(channels[k % len(TOPICS)], 100 * k, bytes([0, 1, 0, 0, k]))
    return path


def selected(
    bag: Path,
    topics: tuple[str, ...] = (),
    allow: bool = False,
    resolve: Callable[[str], str] = str,
) -> Selection:
    with open_bag(bag) as reader:
        return select(bag, reader, topics, allow, resolve)


def names(selection: Selection) -> list[str]:
    return [one.recorded for one in selection.played]


def test_everything_but_what_moves_the_crane(bag: Path) -> None:
    selection = selected(bag)
    assert names(selection) == ["/joint_states", "/robot_description"]
    assert set(selection.left_out) == {"/clock", "/valve_command"}
    assert "--allow-valve-command plays it" in selection.left_out["/valve_command"]


def test_valve_commands_when_told(bag: Path) -> None:
    assert "/valve_command" in names(selected(bag, allow=True))


@pytest.mark.parametrize("onto", ["/valve_command", "/crane_1/valve_command"])
def test_no_other_name_leads_onto_the_valves(onto: str, bag: Path) -> None:
    """Neither a recorded topic that is remapped nor a namespace."""
    renamed = {"/joint_states": onto}
    selection = selected(bag, resolve=lambda name: renamed.get(name, name))
    assert names(selection) == ["/robot_description"]
    with pytest.raises(DataError, match="nothing to play .*/joint_states: would move the crane"):
        selected(bag, ("/joint_states",), resolve=lambda name: onto)


def test_valve_commands_under_another_name(bag: Path) -> None:
    renamed = {"/valve_command": "/recorded_command"}
    selection = selected(bag, resolve=lambda name: renamed.get(name, name))
    played = {one.recorded: one.name for one in selection.played}
    assert played["/valve_command"] == "/recorded_command"


def test_chosen_topics(bag: Path) -> None:
    assert names(selected(bag, ("/joint_states",))) == ["/joint_states"]
    with pytest.raises(DataError, match="bag: no topic /joint_state; the bag holds /clock, /join"):
        selected(bag, ("/joint_state",))


def test_latched_topics_are_latched(bag: Path) -> None:
    services = {one.recorded: one.service for one in selected(bag).played}
    assert services["/robot_description"].latched
    assert services["/robot_description"].depth == 1
    assert not services["/joint_states"].latched


def test_schedule_is_the_bag(bag: Path) -> None:
    with open_bag(bag) as reader:
        due = list(schedule(bag, reader, select(bag, reader, (), True, str)))
    assert [(one.time, one.topic, one.data[-1]) for one in due] == [
        (100 * k, TOPICS[k % len(TOPICS)].name, k)
        for k in range(2 * len(TOPICS))
        if TOPICS[k % len(TOPICS)] is not CLOCK
    ]


def test_types_that_cannot_be_published_are_left_out(
    write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    absent = write_bag([(1, b"")], topic="/x", msgtype="a_msgs/msg/B", msgdef="int8 b", rihs01="x")
    with pytest.raises(DataError, match="/x: message type a_msgs/msg/B is not installed"):
        selected(absent)
    other = write_bag([(1, b"")], name="other", msgdef="int8 b", rihs01="RIHS01_" + "0" * 64)
    with pytest.raises(DataError, match="/joint_states: recorded with another definition of"):
        selected(other)


def test_files_of_a_split_bag_do_not_add_publishers(tmp_path: Path) -> None:
    """Each of them states the same ones, of which one kept one message."""
    path = tmp_path / "split"
    definition = installed_definition(ROBOT_DESCRIPTION.msgtype)
    qos = (offered_qos(ROBOT_DESCRIPTION),)
    with RecordedBag(path) as bag:
        number = bag.add(RecordedTopic("/robot", ROBOT_DESCRIPTION.msgtype, definition, qos))
        for k in range(3):
            bag.begin_file()
            bag.write(number, k, b"\0\1\0\0\2\0\0\0x\0")
    (played,) = selected(path).played
    assert (played.service.latched, played.service.depth) == (True, 1)


@given(
    start=st.integers(0, 2**62),
    now=st.integers(0, 2**62),
    rate=st.floats(0.01, 100.0),
    later=st.integers(0, 10**13),
)
def test_pace(start: int, now: int, rate: float, later: int) -> None:
    """A bag time is due when the clock has run for its share; both ways agree to 1 us."""
    pace = PlaybackPace(start, now, rate)
    assert pace.steady(start) == now
    assert pace.steady(start + later) - now == pytest.approx(later / rate, abs=1.0)
    assert pace.bag(pace.steady(start + later)) == pytest.approx(start + later, abs=1000)
