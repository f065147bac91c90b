"""What a written bag holds, seen with the mcap library and not with the suite's own reader."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from laboratory_crane import JOINTS
from mcap.reader import make_reader

from crane_bags import BagWriter, read_topics, typestore
from crane_bags.types import JOINT_STATES, ROBOT_DESCRIPTION, VALVE_COMMAND
from crane_model import DataError

START = 1_700_000_000_123_456_789


def write(path: Path) -> Path:
    with BagWriter(path) as bag:
        description = bag.add(ROBOT_DESCRIPTION)
        commands = bag.add_arrays(VALVE_COMMAND, JOINTS)
        description.write(START, bag.store.types[ROBOT_DESCRIPTION.msgtype](data="<robot/>"))
        for k in range(3):
            commands.write(START + k * 5_000_000 + 700, START + k * 5_000_000, [0.1 * k] * 4)
    return path


def test_messages_keep_stamp_and_log_time_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "bag")
    with (path / "bag.mcap").open("rb") as stream:
        messages = [
            (message.log_time, schema.name, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
            if channel.topic == VALVE_COMMAND.name
        ]
    assert [time for time, _, _ in messages] == [START + k * 5_000_000 + 700 for k in range(3)]
    assert {name for _, name, _ in messages} == {VALVE_COMMAND.msgtype}
    store = typestore()
    decoded = [store.deserialize_cdr(data, VALVE_COMMAND.msgtype) for _, _, data in messages]
    stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in decoded]
    assert stamps == [START + k * 5_000_000 for k in range(3)]
    assert decoded[2].name == list(JOINTS)
    assert decoded[2].command.tolist() == [0.2] * 4


def test_many_at_once_are_what_one_after_the_other_are(tmp_path: Path) -> None:
    count, random = 6000, np.random.default_rng(5)  # more than one chunk
    stamps = START + 5_000_000 * np.arange(count)
    state, command = random.normal(size=(3, count, 4)), random.normal(size=(count, 4))
    with BagWriter(tmp_path / "one") as bag:
        states = bag.add_arrays(JOINT_STATES, JOINTS)
        commands = bag.add_arrays(VALVE_COMMAND, JOINTS)
        for k, stamp in enumerate(stamps.tolist()):
            states.write(stamp, stamp, *state[:, k])
            commands.write(stamp, stamp, command[k])
    with BagWriter(tmp_path / "many") as bag:
        states = bag.add_arrays(JOINT_STATES, JOINTS)
        commands = bag.add_arrays(VALVE_COMMAND, JOINTS)
        bag.write_together(stamps, {states: tuple(state), commands: (command,)})
    held = []
    for name in ("one", "many"):
        metadata = yaml.safe_load((tmp_path / name / "metadata.yaml").read_text())
        with (tmp_path / name / f"{name}.mcap").open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None and summary.statistics is not None
            assert len(summary.chunk_indexes) > 1
            statistics = replace(summary.statistics, chunk_count=0)
            messages = [
                (channel.topic, message.log_time, message.publish_time, message.data)
                for _, channel, message in reader.iter_messages()
            ]
        information = metadata["rosbag2_bagfile_information"]
        counted = {key: information[key] for key in ("duration", "starting_time", "message_count")}
        held.append((statistics, counted, information["topics_with_message_count"], messages))
    assert held[0] == held[1]
    data = read_topics(tmp_path / "many", [JOINT_STATES])[JOINT_STATES.name]
    assert np.array_equal(data.stamp, stamps)
    assert np.array_equal(data.fields["effort"], state[2])


def test_nothing_at_once_is_nothing(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        commands = bag.add_arrays(VALVE_COMMAND, JOINTS)
        bag.write_together(np.zeros(0, dtype=np.int64), {commands: (np.zeros((0, 4)),)})
    with (tmp_path / "bag/bag.mcap").open("rb") as stream:
        assert list(make_reader(stream).iter_messages()) == []


def test_definitions_hashes_and_qos_as_rosbag2_would_store_them(tmp_path: Path) -> None:
    path = write(tmp_path / "bag")
    with (path / "bag.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = {schema.name: schema for schema in summary.schemas.values()}
    assert schemas[VALVE_COMMAND.msgtype].encoding == "ros2msg"
    assert b"float64[] command" in schemas[VALVE_COMMAND.msgtype].data

    information = yaml.safe_load((path / "metadata.yaml").read_text())
    information = information["rosbag2_bagfile_information"]
    assert information["storage_identifier"] == "mcap"
    topics = {
        one["topic_metadata"]["name"]: one["topic_metadata"]
        for one in information["topics_with_message_count"]
    }
    assert topics[VALVE_COMMAND.name]["type_description_hash"] == typestore().hash_rihs01(
        VALVE_COMMAND.msgtype
    )
    durability = {
        name: [profile["durability"] for profile in topic["offered_qos_profiles"]]
        for name, topic in topics.items()
    }
    assert durability == {
        ROBOT_DESCRIPTION.name: ["transient_local"],
        VALVE_COMMAND.name: ["volatile"],
    }


def test_bag_is_closed_properly_when_the_recording_fails(tmp_path: Path) -> None:
    def record_and_fail() -> None:
        with BagWriter(tmp_path / "bag") as bag:
            states = bag.add_arrays(JOINT_STATES, JOINTS)
            states.write(START, START, [0.0] * 4, [0.0] * 4, [0.0] * 4)
            raise RuntimeError("machine on fire")

    with pytest.raises(RuntimeError, match="machine on fire"):
        record_and_fail()
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        assert len(list(make_reader(stream).iter_messages())) == 1
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


def test_a_bag_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    write(tmp_path / "bag")
    with pytest.raises(DataError, match="bag: cannot make a bag here.*exists already.*Name a"):
        BagWriter(tmp_path / "bag")
