"""Bags that cannot be read: every error names the bag, what is wrong and what to do."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND
from crane_model import DataError

Serializer = Callable[..., bytes]
BagMaker = Callable[..., Path]


def refusal(path: Path) -> str:
    """The message of the error that reading the joint states of a bag raises."""
    with pytest.raises(DataError) as error:
        read_topics(path, [JOINT_STATES])[JOINT_STATES.name].select(["slew"])
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.fixture
def make(joint_state: Serializer, write_bag: BagMaker) -> BagMaker:
    def write(storage: StoragePlugin = StoragePlugin.MCAP, count: int = 500) -> Path:
        names = ["slew", "telescope"]
        return write_bag([(k, joint_state(k, names, [0.1, 0.2])) for k in range(count)], storage)

    return write


def test_no_such_path(tmp_path: Path) -> None:
    assert "no such bag" in refusal(tmp_path / "absent")


def test_folder_that_is_no_bag(tmp_path: Path) -> None:
    assert "not a bag; name a folder with metadata.yaml" in refusal(tmp_path)


def test_file_that_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("hello")
    assert "not a bag" in refusal(path)


def test_empty_bag(make: BagMaker) -> None:
    assert "the bag is empty" in refusal(make(count=0))


@pytest.mark.parametrize("storage", StoragePlugin)
def test_empty_file(storage: StoragePlugin, make: BagMaker) -> None:
    path = make(storage)
    for file in path.glob("bag.*"):
        file.write_bytes(b"")
    assert "the bag is damaged" in refusal(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
def test_mcap_without_its_end(share: float, make: BagMaker) -> None:
    path = make()
    file = path / "bag.mcap"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    assert "was not closed properly: bag.mcap has no end" in refusal(path)
    assert "was not closed properly" in refusal(file)


def test_folder_of_a_recorder_that_was_killed(make: BagMaker) -> None:
    path = make()
    (path / "metadata.yaml").unlink()
    assert "was not closed properly: bag.mcap is there, but no metadata.yaml" in refusal(path)


def test_sqlite_file_cut_short(make: BagMaker) -> None:
    path = make(StoragePlugin.SQLITE3)
    file = path / "bag.db3"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert "the bag is damaged" in refusal(path)


@pytest.mark.parametrize("storage", StoragePlugin)
def test_noise_in_the_middle(storage: StoragePlugin, make: BagMaker) -> None:
    path = make(storage)
    (file,) = path.glob("bag.*")
    content = bytearray(file.read_bytes())
    content[len(content) // 4 : 3 * len(content) // 4] = b"\xff" * (len(content) // 2)
    file.write_bytes(content)
    assert "the bag is damaged" in refusal(path)


def test_metadata_that_is_no_metadata(make: BagMaker) -> None:
    path = make()
    (path / "metadata.yaml").write_text("- 1\n")
    assert "the bag is damaged" in refusal(path)


def test_files_that_are_missing(make: BagMaker) -> None:
    path = make()
    (path / "bag.mcap").unlink()
    message = refusal(path)
    assert "bag.mcap" in message
    assert "copy it again" in message


REMEDY = "give it the name that is stated, or name the file itself"


def test_a_file_with_another_name_than_the_metadata_state(make: BagMaker) -> None:
    path = make()
    (path / "bag.mcap").rename(path / "renamed.mcap")
    message = refusal(path)
    assert "bag.mcap" in message
    assert f"the folder holds renamed.mcap: {REMEDY}: {path / 'renamed.mcap'}" in message


@pytest.mark.parametrize("storage", StoragePlugin)
def test_metadata_that_state_more_than_the_files_hold(
    storage: StoragePlugin, make: BagMaker
) -> None:
    path = make(storage)
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    topics[0]["message_count"] = 600
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    data = read_topics(path, [JOINT_STATES])[JOINT_STATES.name]
    assert len(data.stamp) == 500
    assert data.notes == (
        "/joint_states: metadata.yaml states 600 messages, the files are whole and hold 500; if "
        "more were recorded, copy the bag again",
    )


def test_topic_that_only_the_metadata_know(make: BagMaker) -> None:
    path = make()
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    topics.append({"message_count": 500, "topic_metadata": dict(topics[0]["topic_metadata"])})
    topics[1]["topic_metadata"] |= {"name": VALVE_COMMAND.name, "type": VALVE_COMMAND.msgtype}
    topics[1]["topic_metadata"]["type_description_hash"] = ""
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with pytest.raises(DataError, match="valve_command holds no message, and metadata.* 500; che"):
        read_topics(path, [VALVE_COMMAND])
    found = read_topics(path, [JOINT_STATES], [VALVE_COMMAND])
    assert set(found) == {JOINT_STATES.name}
    (note,) = found[JOINT_STATES.name].notes
    assert "/valve_command: metadata.yaml states 500 messages, the files are whole" in note


def test_missing_topic(make: BagMaker) -> None:
    path = make()
    with pytest.raises(DataError, match="no topic /cylinder_pressures; the bag holds /joint_state"):
        read_topics(path, [JOINT_STATES, CYLINDER_PRESSURES])


def test_topic_without_messages(tmp_path: Path, make: BagMaker) -> None:
    path = make()
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    topics.append({"message_count": 0, "topic_metadata": dict(topics[0]["topic_metadata"])})
    topics[1]["topic_metadata"]["name"] = CYLINDER_PRESSURES.name
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with pytest.raises(DataError, match="/cylinder_pressures holds no message; check its publ"):
        read_topics(path, [JOINT_STATES, CYLINDER_PRESSURES])
    assert set(read_topics(path, [JOINT_STATES], [CYLINDER_PRESSURES])) == {JOINT_STATES.name}


def test_topic_of_another_type(joint_state: Serializer, write_bag: BagMaker) -> None:
    path = write_bag([(1, joint_state(1, ["slew"], [0.0]))], topic=VALVE_COMMAND.name)
    message = (
        "/valve_command is of type sensor_msgs/msg/JointState, expected "
        "crane_interfaces/msg/ValveCommand"
    )
    with pytest.raises(DataError, match=message):
        read_topics(path, [VALVE_COMMAND])


def test_another_version_of_a_message(joint_state: Serializer, write_bag: BagMaker) -> None:
    path = write_bag(
        [(1, joint_state(1, ["slew"], [0.0]))],
        msgdef="float64 angle\n",
        rihs01="RIHS01_" + "0" * 64,
    )
    assert "another definition of sensor_msgs/msg/JointState" in refusal(path)


def test_bytes_that_are_no_such_message(write_bag: BagMaker) -> None:
    path = write_bag([(1, b"\x00\x01\x00\x00" + b"\x07" * 20)])
    assert "topic /joint_states" in refusal(path)


def test_arrays_that_do_not_fit_the_names(joint_state: Serializer, write_bag: BagMaker) -> None:
    path = write_bag([(1, joint_state(1, ["slew"], [0.0, 1.0]))])
    assert "position has 2 values for ['slew']" in refusal(path)


def test_missing_joint(make: BagMaker) -> None:
    data = read_topics(make(), [JOINT_STATES])[JOINT_STATES.name]
    message = "/joint_states has no inner_boom; it has slew, telescope; rename the joints"
    with pytest.raises(DataError, match=message):
        data.select(["slew", "inner_boom"])


def test_joints_that_never_come_together(joint_state: Serializer, write_bag: BagMaker) -> None:
    messages = [(1, joint_state(1, ["a"], [0.0])), (2, joint_state(2, ["b"], [0.0]))]
    data = read_topics(write_bag(messages), [JOINT_STATES])[JOINT_STATES.name]
    with pytest.raises(DataError, match="no message that holds all of a, b"):
        data.select(["a", "b"])


def test_clock_that_steps_back(joint_state: Serializer, write_bag: BagMaker) -> None:
    stamps = [10 * 10**9, 11 * 10**9, 5 * 10**9]
    messages = [(k, joint_state(stamp, ["slew"], [0.0])) for k, stamp in enumerate(stamps)]
    assert "the clock steps back by 6.000 s at message 2" in refusal(write_bag(messages))
