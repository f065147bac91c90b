"""Bags written by others (conftest: rosbags; here: the mcap library) come back as they were."""

import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from laboratory_crane import JOINTS
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from crane_bags import BagWriter, TopicData, read_topics, typestore
from crane_bags.clocks import SetBack, clock_step
from crane_bags.storage import (
    BLOCK_MESSAGES,
    MESSAGE_HEADER_BYTES,
    RECORD_HEADER_BYTES,
    messages,
    open_bag,
)
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES, VALVE_COMMAND
from crane_bags.writer import offered_qos
from crane_model import DataError

START = 1_700_000_000_000_000_000
STEP = 5_000_000
Message = tuple[int, bytes]
Serializer = Callable[..., bytes]
BagMaker = Callable[..., Path]


def joint_states(path: Path) -> TopicData:
    return read_topics(path, [JOINT_STATES])[JOINT_STATES.name]


@pytest.fixture
def five_messages(joint_state: Serializer) -> list[Message]:
    """Position of joint i in message k: 10 k + i."""
    return [
        (
            START + k * STEP + 99,
            joint_state(START + k * STEP, JOINTS, [10 * k + i for i in range(4)]),
        )
        for k in range(5)
    ]


def check_five_messages(data: TopicData) -> None:
    assert data.stamp.tolist() == [START + k * STEP for k in range(5)]
    assert data.stamped_by == "header"
    assert data.names == JOINTS
    expected = 10 * np.arange(5)[:, None] + np.arange(4)
    np.testing.assert_array_equal(data.fields["position"], expected)
    assert np.isnan(data.fields["velocity"]).all()  # the arrays in the messages are empty
    assert data.notes == ()


@pytest.mark.parametrize("storage", StoragePlugin)
@pytest.mark.parametrize("as_file", [False, True])
def test_either_storage_as_folder_or_file(
    storage: StoragePlugin, as_file: bool, five_messages: list[Message], write_bag: BagMaker
) -> None:
    path = write_bag(five_messages, storage, qos=[offered_qos(JOINT_STATES)])
    if as_file:
        (path,) = (file for file in path.iterdir() if file.suffix != ".yaml")
    check_five_messages(joint_states(path))


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunked", [True, False])
def test_mcap_of_the_mcap_library(
    compression: CompressionType, chunked: bool, five_messages: list[Message], tmp_path: Path
) -> None:
    path = tmp_path / "foreign.mcap"
    definition, _ = typestore().generate_msgdef(JOINT_STATES.msgtype, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATES.msgtype, "ros2msg", definition.encode())
        channel = writer.register_channel(JOINT_STATES.name, "cdr", schema)
        for log_time, data in five_messages:
            writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    check_five_messages(joint_states(path))


@pytest.mark.parametrize(
    "options",
    [
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
        {"use_statistics": False, "index_types": IndexType.NONE},
        {"use_statistics": False, "index_types": IndexType.CHUNK},
    ],
    ids=lambda options: " ".join(options),
)
def test_summary_that_repeats_little(
    options: dict, five_messages: list[Message], tmp_path: Path
) -> None:
    """The format leaves it to writers; the data section is read on."""
    path = tmp_path / "foreign.mcap"
    definition, _ = typestore().generate_msgdef(JOINT_STATES.msgtype, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=400, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATES.msgtype, "ros2msg", definition.encode())
        channel = writer.register_channel(JOINT_STATES.name, "cdr", schema)
        for log_time, data in five_messages:
            writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    check_five_messages(joint_states(path))
    with open_bag(path) as reader:
        assert [one.topic for one in reader.connections] == [JOINT_STATES.name]
        assert len(list(messages(path, reader, [JOINT_STATES.name]))) == 5


@pytest.mark.parametrize("storage", StoragePlugin)
@pytest.mark.parametrize("listed", [True, False])
def test_the_files_decide_how_many_messages_there_are(
    storage: StoragePlugin, listed: bool, five_messages: list[Message], write_bag: BagMaker
) -> None:
    """metadata.yaml states none, as after a reindex, or does not list the topic at all."""
    path = write_bag(five_messages, storage)
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    information["message_count"] = 0
    information["topics_with_message_count"][0]["message_count"] = 0
    if not listed:
        information["topics_with_message_count"] = []
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    data = read_topics(path, [], [JOINT_STATES])[JOINT_STATES.name]
    assert data.stamp.tolist() == [START + k * STEP for k in range(5)]
    assert data.notes == (
        "/joint_states: metadata.yaml states 0 messages, the files hold 5; all of them are used",
    )


def test_the_files_decide_of_which_type_a_topic_is(
    five_messages: list[Message], write_bag: BagMaker
) -> None:
    path = write_bag(five_messages)
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace(JOINT_STATES.msgtype, "std_msgs/msg/String"))
    check_five_messages(joint_states(path))


def test_a_clock_that_all_messages_follow_back_was_set(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    """By less than messages may overtake one another in a recording, but its clock goes back."""
    step, back = 10_000_000, 150_000_000
    times = [START + k * step - back * (k >= 50) for k in range(100)]
    path = write_bag([(time, joint_state(time, ["slew"], [0.0])) for time in times])
    with pytest.raises(DataError, match=r"the clock steps back by 0\.140 s at message 50"):
        joint_states(path)


def test_one_stamp_for_all_messages_is_no_time(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    data, positions = read_stamps([START] * 50, joint_state, write_bag)
    assert data.stamped_by == "log time" and len(positions) == 50
    assert data.notes == ("/joint_states: 1 header stamps in all, log time used (50)",)


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4], [3, 0, 4, 1, 2]], ids=["in order", "mixed"])
def test_many_chunks_and_two_publishers(
    order: list[int], five_messages: list[Message], tmp_path: Path
) -> None:
    """Whether chunks follow one another in time or not, messages come in order of log time."""
    path = tmp_path / "foreign.mcap"
    definition, _ = typestore().generate_msgdef(JOINT_STATES.msgtype, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=200)  # one message, or two
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATES.msgtype, "ros2msg", definition.encode())
        channels = [
            writer.register_channel(JOINT_STATES.name, "cdr", schema, {"of": str(publisher)})
            for publisher in range(2)
        ]
        for k in order:
            log_time, data = five_messages[k]
            writer.add_message(channels[k % 2], log_time, data, log_time)
        writer.finish()
    check_five_messages(joint_states(path))


def test_a_file_without_the_profile_of_ros_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    remedy = f"recover {path} --out {tmp_path / 'foreign'}_recovered"
    with pytest.raises(DataError, match=f"does not say that it is of ROS 2; .*{remedy}"):
        joint_states(path)


def test_a_schema_that_is_not_of_ros_is_told(five_messages: list[Message], tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("foxglove.Log", "jsonschema", b"{}")
        channel = writer.register_channel("/log", "json", schema)
        writer.add_message(channel, START, b"{}", START)
        writer.finish()
    with pytest.raises(DataError, match="a schema of the kind 'jsonschema', and topics of ROS 2"):
        joint_states(path)


def test_record_longer_than_its_chunk(five_messages: list[Message], tmp_path: Path) -> None:
    """No checksum tells, the lengths do."""
    path = tmp_path / "foreign.mcap"
    definition, _ = typestore().generate_msgdef(JOINT_STATES.msgtype, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATES.msgtype, "ros2msg", definition.encode())
        channel = writer.register_channel(JOINT_STATES.name, "cdr", schema)
        for log_time, data in five_messages:
            writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    content = bytearray(path.read_bytes())
    record = content.index(five_messages[-1][1]) - MESSAGE_HEADER_BYTES - RECORD_HEADER_BYTES
    content[record + 2] ^= 0x80  # the second byte of its length
    path.write_bytes(content)
    with pytest.raises(DataError, match="damaged"):
        joint_states(path)


@pytest.mark.parametrize("storage", StoragePlugin)
@pytest.mark.parametrize("sorted_by_time", [True, False])
def test_split_bag(
    sorted_by_time: bool,
    storage: StoragePlugin,
    five_messages: list[Message],
    write_bag: BagMaker,
) -> None:
    first = write_bag(five_messages[:2], storage, "first")
    second = write_bag(five_messages[2:], storage, "second")
    (part,) = (file for file in second.iterdir() if file.suffix != ".yaml")
    part.rename(first / part.name)
    metadata = yaml.safe_load((first / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    information["relative_file_paths"].insert(1 if sorted_by_time else 0, part.name)
    information["topics_with_message_count"][0]["message_count"] = 5
    (first / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    check_five_messages(joint_states(first))


def test_a_file_that_the_metadata_do_not_list_is_told(
    five_messages: list[Message], write_bag: BagMaker
) -> None:
    path, other = write_bag(five_messages), write_bag(five_messages, name="other")
    (other / "other.mcap").rename(path / "other.mcap")
    data = joint_states(path)
    assert len(data.stamp) == 5
    (note,) = data.notes
    assert note.startswith("other.mcap: not read, because metadata.yaml does not list it; repair")


def test_time_that_goes_back_in_messages_compressed_one_by_one(
    joint_state: Serializer, tmp_path: Path
) -> None:
    times = [START + k * STEP for k in (0, 1, 3, 2, 4)]
    store = typestore()
    writer = RosbagsWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection(JOINT_STATES.name, JOINT_STATES.msgtype, typestore=store)
        for time in times:
            writer.write(topic, time, joint_state(time, JOINTS, [0.0] * 4))
    back = joint_states(tmp_path / "bag").select(JOINTS).set_back
    assert back is not None
    assert (back.times, back.largest, back.behind, back.logged) == (1, STEP, 1, True)


def test_qos_of_the_metadata_that_the_file_does_not_state(
    five_messages: list[Message], write_bag: BagMaker
) -> None:
    """As in bags out of `ros2 bag convert`; rosbags alone yields none of their messages."""
    path = write_bag(five_messages, StoragePlugin.SQLITE3, qos=[offered_qos(JOINT_STATES)])
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute("UPDATE topics SET offered_qos_profiles = ''")
    check_five_messages(joint_states(path))


def test_own_bag_with_several_topics_longer_than_a_block(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    count = BLOCK_MESSAGES + 10
    states, pressures = random.normal(size=(count, 3, 4)), random.normal(size=(count, 2, 3))
    pressures[7, 0, 1] = np.nan
    with BagWriter(tmp_path / "bag") as bag:
        state_channel = bag.add_arrays(JOINT_STATES, JOINTS)
        pressure_channel = bag.add_arrays(CYLINDER_PRESSURES, JOINTS[1:])
        for k in range(count):
            stamp = START + k * STEP
            state_channel.write(stamp + 50, stamp, *states[k])
            pressure_channel.write(stamp + 60, stamp + 10, *pressures[k], 1e7 + k, np.nan)
    shares: list[float] = []
    data = read_topics(
        tmp_path / "bag",
        [JOINT_STATES, CYLINDER_PRESSURES],
        [VALVE_COMMAND],
        lambda _, share: shares.append(share),
    )
    assert set(data) == {JOINT_STATES.name, CYLINDER_PRESSURES.name}
    for index, field in enumerate(("position", "velocity", "effort")):
        np.testing.assert_array_equal(data[JOINT_STATES.name].fields[field], states[:, index])
    pressure = data[CYLINDER_PRESSURES.name]
    np.testing.assert_array_equal(pressure.fields["chamber_a"], pressures[:, 0])
    np.testing.assert_array_equal(pressure.fields["supply"], 1e7 + np.arange(count))
    assert np.isnan(pressure.fields["tank"]).all()
    assert pressure.stamp[-1] == START + (count - 1) * STEP + 10
    assert len(shares) >= 2
    assert sorted(shares) == shares
    assert shares[-1] == 1.0


def test_optional_topics_only_may_all_be_missing(
    five_messages: list[Message], write_bag: BagMaker
) -> None:
    assert read_topics(write_bag(five_messages), [], [VALVE_COMMAND, JOINT_REFERENCE]) == {}


def test_select_reorders_joints_by_name(five_messages: list[Message], write_bag: BagMaker) -> None:
    data = joint_states(write_bag(five_messages)).select(["telescope", "slew"])
    assert data.names == ("telescope", "slew")
    assert data.fields["position"].tolist() == [[10 * k + 3, 10 * k] for k in range(5)]


def test_order_of_names_that_changes_and_a_second_publisher(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    """Another node publishes the gripper on the same topic, at the very same times."""
    messages = [
        (1, joint_state(1, ["slew", "telescope"], [1.0, 2.0])),
        (1, joint_state(1, ["gripper"], [9.0])),
        (2, joint_state(2, ["telescope", "slew"], [4.0, 3.0])),
        (2, joint_state(2, ["gripper"], [9.5])),
    ]
    data = joint_states(write_bag(messages))
    assert set(data.names) == {"slew", "telescope", "gripper"}
    crane, gripper = data.select(["slew", "telescope"]), data.select(["gripper"])
    assert crane.fields["position"].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert gripper.fields["position"].tolist() == [[9.0], [9.5]]
    assert crane.notes == gripper.notes == ()


def read_stamps(
    stamps: Sequence[int], joint_state: Serializer, write_bag: BagMaker
) -> tuple[TopicData, list[float]]:
    """Joint states with these header stamps, logged one after the other; and their positions."""
    messages = [
        (START + k, joint_state(stamp, ["slew"], [float(k)])) for k, stamp in enumerate(stamps)
    ]
    data = joint_states(write_bag(messages)).select(["slew"])
    return data, data.fields["position"][:, 0].tolist()


def test_repeated_stamps_keep_the_first_message(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    data, positions = read_stamps([10, 20, 20, 20, 30], joint_state, write_bag)
    assert data.stamp.tolist() == [10, 20, 30]
    assert positions == [0.0, 1.0, 4.0]
    assert data.notes == ("/joint_states: repeated stamps dropped (2)",)


def test_messages_that_overtook_one_another_are_sorted(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    data, positions = read_stamps([10, 30, 20, 40], joint_state, write_bag)
    assert data.stamp.tolist() == [10, 20, 30, 40]
    assert positions == [0.0, 2.0, 1.0, 3.0]
    assert data.set_back == SetBack(1, largest=10, interval=20, behind=1, total=4, logged=False)
    (note,) = data.notes
    assert note.startswith("/joint_states: time goes back 1 time, by up to 1e-08 s")


@pytest.mark.parametrize("storage", StoragePlugin)
def test_time_that_goes_back_in_both_stamps_is_seen_in_the_order_of_the_file(
    storage: StoragePlugin, joint_state: Serializer, write_bag: BagMaker
) -> None:
    """Seven milliseconds every 25 messages of 5 ms: readers that sort by log time see nothing."""
    stamps = [START + k * STEP - 7_000_000 * (k // 25) for k in range(200)]
    messages = [(stamp, joint_state(stamp, ["slew"], [0.0])) for stamp in stamps]
    back = joint_states(write_bag(messages, storage)).select(["slew"]).set_back
    assert back == SetBack(7, 2_000_000, interval=STEP, behind=7, total=200, logged=True)


def test_log_time_where_no_header_is_stamped(joint_state: Serializer, write_bag: BagMaker) -> None:
    data, positions = read_stamps([0, 0, 0], joint_state, write_bag)
    assert data.stamp.tolist() == [START, START + 1, START + 2]
    assert positions == [0.0, 1.0, 2.0]
    assert data.stamped_by == "log time"
    assert data.notes == ("/joint_states: no header stamp, log time used (3)",)


def test_a_recording_that_begins_at_time_zero_keeps_its_header_stamps(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    data, _ = read_stamps([0, STEP, 2 * STEP], joint_state, write_bag)
    assert data.stamp.tolist() == [0, STEP, 2 * STEP]
    assert data.stamped_by == "header"


def test_messages_before_the_clock_was_set_are_left_out(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    data, positions = read_stamps([0, 0, START, START + STEP], joint_state, write_bag)
    assert data.stamp.tolist() == [START, START + STEP]
    assert positions == [2.0, 3.0]
    assert data.notes == ("/joint_states: messages whose header stamp is zero left out (2)",)


def stamps_and_log_times(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """A publisher at 200 Hz, received 0.2 to 2 ms later."""
    rng = np.random.default_rng(4)
    stamp = START + np.arange(count) * STEP
    return stamp, np.maximum.accumulate(stamp + rng.integers(200_000, 2_000_000, count))


@pytest.mark.parametrize("change", [-2.0, -0.3, 0.3, 5.0, 1e7])
def test_a_clock_that_is_set_is_refused_at_its_message(
    change: float, joint_state: Serializer, write_bag: BagMaker
) -> None:
    stamp, log_time = stamps_and_log_times(600)
    stamp[400:] += round(change * 1e9)
    messages = [
        (int(log), joint_state(int(at), ["a"], [0.0]))
        for at, log in zip(stamp, log_time, strict=True)
    ]
    which = "back" if change < 0 else "forward"
    path = write_bag(messages)
    with pytest.raises(DataError, match=rf"clock steps {which} by [\d.]+ s at message 400, stamp"):
        joint_states(path)


def test_what_looks_like_a_clock_that_is_set() -> None:
    """Pauses of the machine, of the recorder and of its clock, a late burst, drift: none is one."""
    stamp, log_time = stamps_and_log_times()
    late = np.zeros(len(stamp), dtype=np.int64)
    late[1000:1400] = np.arange(400)[::-1] * STEP  # two seconds wait, then come at once
    lost = np.delete(np.arange(len(stamp)), np.arange(1001, 1200))  # half of which the queue lost
    pause = np.where(np.arange(len(stamp)) < 2000, 0, 30 * 10**9)
    slow = (0.01 * (stamp - START)).astype(np.int64)
    assert clock_step(stamp, log_time + late) is None
    assert clock_step(stamp[lost], (log_time + late)[lost]) is None
    assert clock_step(stamp + pause, log_time + pause) is None
    assert clock_step(stamp, log_time + pause) is None  # a bag that was played, and paused
    assert clock_step(stamp, log_time + slow) is None
    latched = stamp.copy()
    latched[0] -= 60 * 10**9
    assert clock_step(latched, log_time) is None
    assert clock_step(stamp + pause, START + np.arange(len(stamp))) is None  # log times are made up
    row, change = clock_step(stamp + pause // 100 - 2 * slow, log_time) or (0, 0)
    assert (row, change / 1e9) == (2000, pytest.approx(0.3, abs=2e-3))


def test_nan_and_partly_filled_arrays_are_kept(
    joint_state: Serializer, write_bag: BagMaker
) -> None:
    messages = [
        (1, joint_state(1, ["a", "b"], [1.0, np.nan], velocity=[0.1, 0.2])),
        (2, joint_state(2, ["a", "b"], [2.0, 3.0])),
    ]
    fields = joint_states(write_bag(messages)).select(["a", "b"]).fields
    np.testing.assert_array_equal(fields["position"], [[1.0, np.nan], [2.0, 3.0]])
    np.testing.assert_array_equal(fields["velocity"], [[0.1, 0.2], [np.nan, np.nan]])
