"""Commands of a bag, as they reached the valves."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from crane_bags import BagWriter, typestore
from crane_bags.reader import let_through
from crane_bags.types import CYLINDER_PRESSURES, DRIVER_STATE, VALVE_COMMAND
from crane_model import DataError
from crane_observer import HeardRecording
from crane_observer.recording import AlignedEncoders, reached


def test_commands_are_neutral_while_the_driver_lets_none_through() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0])
    commands = np.array([[0.1], [0.2], [0.3], [0.4]])
    told, through = np.array([0.5, 1.5, 2.5]), np.array([True, False, True])
    when, values = reached(time, commands, told, through)
    np.testing.assert_array_equal(when, [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    np.testing.assert_array_equal(values[:, 0], [0.1, 0.1, 0.2, 0.0, 0.0, 0.3, 0.4])


def test_without_driver_states_commands_are_as_they_are() -> None:
    time, commands = np.arange(3.0), np.ones((3, 2))
    when, values = reached(time, commands, np.zeros(0), np.zeros(0, dtype=bool))
    assert when is time and values is commands


def test_a_bag_tells_when_commands_reached_the_valves(tmp_path: Path) -> None:
    store, topic = typestore(), DRIVER_STATE.within("/left")
    kind = store.types[topic.msgtype]
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    states = (kind.STATE_DISABLED, kind.STATE_ENABLED, kind.STATE_FAULT, kind.STATE_DEGRADED)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(topic.name, topic.msgtype, typestore=store)
        for second, state in enumerate(states):
            told = kind(
                header=header(stamp(sec=second, nanosec=5), ""), node="", state=state, text="",
                fault=0, source="", further_faults=0, cause="", remedy="", substituted="",
                commands_refused=0, last_refusal="",
            )  # fmt: skip
            writer.write(connection, second, store.serialize_cdr(told, topic.msgtype))
    stamps, through = let_through(tmp_path / "bag", "/left")
    np.testing.assert_array_equal(stamps, np.arange(4) * 10**9 + 5)
    assert through.tolist() == [False, True, False, True]
    assert not len(let_through(tmp_path / "bag", "/")[0])


@pytest.mark.parametrize(("messages", "refused"), [(25, True), (150, False)])
def test_time_that_goes_back_is_told_and_refused_beyond_a_share(
    messages: int, refused: bool, tmp_path: Path
) -> None:
    """Both stamps go back by 7 ms every so many messages of 5 ms."""
    joints = ("boom", "stick")
    with BagWriter(tmp_path / "bag") as bag:
        pressures = bag.add_arrays(CYLINDER_PRESSURES, joints)
        commands = bag.add_arrays(VALVE_COMMAND, joints)
        for k in range(600):
            stamp = 10**18 + k * 5_000_000 - 7_000_000 * (k // messages)
            pressures.write(stamp, stamp, np.ones(2), np.ones(2), 1.0, 0.0)
            commands.write(stamp, stamp, np.zeros(2))
    if refused:
        with pytest.raises(DataError, match="time goes back 23 times, by up to 0.002 s"):
            HeardRecording.read(tmp_path / "bag", joints)
    else:
        notes = HeardRecording.read(tmp_path / "bag", joints).notes
        assert len(notes) == 2 and all("time goes back 3 times" in note for note in notes)


def test_readings_of_sensors_that_are_late_are_given_for_one_time() -> None:
    """Joints at a constant speed, whose sensors are late by nothing, one and two and a half
    readings; and a reading that no latency changes.
    """
    speed, latency = np.array([1.0, -2.0, 0.5]), np.array([0.0, 0.02, 0.05])
    encoders = AlignedEncoders(latency)
    for k in range(20):
        time = 0.02 * k + 0.003 * (k % 2)
        found = encoders.at(time, speed * (time - latency))
        if k > 3:
            assert found.time == pytest.approx(time - 0.05)
            np.testing.assert_allclose(found.position, speed * found.time)
    position = np.array([1.0, np.nan])
    assert AlignedEncoders(np.zeros(2)).at(7.0, position).position is position
