"""Bags that are written while messages arrive, as other readers see them."""

import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from crane_bags import read_topics
from crane_bags.types import JOINT_STATES, ROBOT_DESCRIPTION
from crane_bags.writer import offered_qos
from crane_model import DataError
from crane_nodes.recording.bag import RecordedBag, RecordedTopic, Split, installed_definition

Recorder = Callable[..., Path]
SAMPLE = "rosbag2_samples/mcap/convert_a/metadata.yaml"


def positions(bag: Path) -> list[float]:
    data = read_topics(bag, [JOINT_STATES])[JOINT_STATES.name]
    return data.fields["position"][:, 0].tolist()


def test_every_message_is_read_in_order(record: Recorder) -> None:
    assert positions(record(1000)) == [float(k) for k in range(1000)]


def test_remarks_stand_in_the_metadata(tmp_path: Path, topic: RecordedTopic) -> None:
    with RecordedBag(tmp_path / "bag") as bag:
        bag.add(topic)
        bag.remarks["silent /joint_states"] = "57.0 s"
    with Reader(bag.path) as reader:
        assert reader.message_count == 0
    stated = yaml.safe_load((bag.path / "metadata.yaml").read_text())
    assert stated["rosbag2_bagfile_information"]["custom_data"] == bag.remarks


def test_topic_is_described(record: Recorder, topic: RecordedTopic) -> None:
    path = record(10)
    with Reader(path) as reader:
        (stated,) = reader.connections
        (stored,) = reader.storage.storages[0].connections
    for one in (stated, stored):
        assert (one.topic, one.msgtype) == (topic.name, topic.msgtype)
        assert tuple(one.ext.offered_qos_profiles) == topic.offered_qos
    assert stated.digest == topic.definition.type_hash
    assert stored.msgdef.data == topic.definition.text
    assert stated.msgcount == 10


def test_file_says_all_that_rosbag2_writes(record: Recorder, topic: RecordedTopic) -> None:
    with (record(10) / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        (channel,) = summary.channels.values()
        assert channel.metadata["topic_type_hash"] == topic.definition.type_hash
        assert summary.statistics.message_count == 10
        (record_of_rosbag2,) = reader.iter_metadata()
        own = yaml.safe_load(record_of_rosbag2.metadata["serialized_metadata"])
        assert own["relative_file_paths"] == ["bag_0.mcap"]
        messages = [message for _, _, message in reader.iter_messages()]
    assert [one.sequence for one in messages] == list(range(1, 11))
    assert [one.publish_time for one in messages] == [one.log_time for one in messages]


def test_metadata_have_the_form_of_rosbag2(record: Recorder, real_data: Path) -> None:
    """The keys of a bag of rosbag2 itself, and those that came with versions 6 to 9."""
    theirs = yaml.safe_load((real_data / SAMPLE).read_text())["rosbag2_bagfile_information"]
    ours = yaml.safe_load((record(10) / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert set(ours) == set(theirs) | {"custom_data", "ros_distro"}
    assert set(ours["files"][0]) == set(theirs["files"][0])
    topics = [one["topics_with_message_count"][0]["topic_metadata"] for one in (ours, theirs)]
    assert set(topics[0]) == set(topics[1]) | {"type_description_hash"}
    assert ours["version"] == 9


@pytest.mark.parametrize("split", [Split(duration=0.5), Split(size=20_000)])
def test_split_bag_reads_as_one(split: Split, record: Recorder) -> None:
    path = record(1000, split=split)
    files = sorted(path.glob("*.mcap"), key=lambda file: int(file.stem.split("_")[1]))
    assert [file.name for file in files] == [f"bag_{k}.mcap" for k in range(len(files))]
    assert len(files) > 5
    assert positions(path) == [float(k) for k in range(1000)]
    assert [k for file in files for k in positions(file)] == positions(path)


def test_split_by_duration(record: Recorder) -> None:
    path = record(250, split=Split(duration=0.5))
    assert [len(positions(file)) for file in sorted(path.glob("*.mcap"))] == [100, 100, 50]


def test_split_by_size(record: Recorder) -> None:
    path = record(2000, split=Split(size=50_000))
    sizes = [file.stat().st_size for file in path.glob("*.mcap")]
    described = min(file.stat().st_size for file in record(0, name="empty").glob("*.mcap"))
    assert max(sizes) < 50_000 + 3 * described + 1000


def test_topic_that_comes_later_is_in_the_following_files(
    tmp_path: Path, topic: RecordedTopic, joint_state: Callable[..., bytes]
) -> None:
    description = RecordedTopic(
        ROBOT_DESCRIPTION.name,
        ROBOT_DESCRIPTION.msgtype,
        installed_definition(ROBOT_DESCRIPTION.msgtype),
        (offered_qos(ROBOT_DESCRIPTION),),
    )
    with RecordedBag(tmp_path / "bag") as bag:
        states = bag.add(topic)
        bag.write(states, 1, joint_state(1, ["slew"], [1.0]))
        bag.begin_file()
        bag.begin_file()  # one that stays without messages
        robot = bag.add(description)
        bag.write(robot, 2, b"\0\1\0\0\2\0\0\0x\0")
        bag.write(states, 3, joint_state(3, ["slew"], [3.0]))
    with Reader(tmp_path / "bag") as reader:
        assert {one.topic: one.msgcount for one in reader.connections} == {
            topic.name: 2,
            description.name: 1,
        }
        assert [stamp for _, stamp, _ in reader.messages()] == [1, 2, 3]


def test_bag_without_messages_is_empty_not_damaged(record: Recorder) -> None:
    with pytest.raises(DataError, match="the bag is empty"):
        positions(record(0))


def test_open_bag_is_no_bag_to_readers(record: Recorder) -> None:
    path = record(100, close=False)
    message = f"ros2 run crane_nodes recover {path} --out {path}_recovered"
    with pytest.raises(DataError, match=f"bag_0.mcap is there, but no metadata.yaml; .*{message}"):
        positions(path)
    with pytest.raises(DataError, match="recover .*bag_0.mcap --out .*/bag_0_recovered"):
        positions(path / "bag_0.mcap")


def test_flushed_messages_are_on_disk(record: Recorder) -> None:
    path = record(130, close=False, flush=50)
    found = 0
    with (path / "bag_0.mcap").open("rb") as stream, pytest.raises(Exception, match="^$"):
        for one in StreamReader(stream, validate_crcs=True).records:
            found += type(one).__name__ == "Message"
    assert found == 100


def test_folder_that_exists_is_refused(record: Recorder) -> None:
    path = record(1)
    with pytest.raises(DataError, match=f"{path}: cannot make a bag here: File exists; name a fo"):
        RecordedBag(path)


@pytest.fixture
def small_disk() -> Iterator[None]:
    """No file may grow beyond 100 kB."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_disk_that_is_full_is_named(small_disk: None, record: Recorder, tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match="/bag: cannot write: File too large; make room, then repair"
    ):
        record(5000)
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
