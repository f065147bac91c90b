"""What a sample costs on its way into a bag, and out of it."""

import time
from pathlib import Path

import numpy as np
from laboratory_crane import JOINTS
from rosbags.rosbag2 import Reader

from crane_bags import BagWriter, read_topics, typestore
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES, VALVE_COMMAND
from crane_driver import VelocityFilter

STEP = 5_000_000  # ns
TOPICS = (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)


def test_bag_of_four_topics(tmp_path: Path, measured) -> None:
    count = 20_000
    values = np.random.default_rng(0).normal(size=(count, 3, 4))
    with BagWriter(tmp_path / "bag") as bag:
        states = bag.add_arrays(JOINT_STATES, JOINTS)
        pressures = bag.add_arrays(CYLINDER_PRESSURES, JOINTS[1:])
        commands = bag.add_arrays(VALVE_COMMAND, JOINTS)
        references = bag.add_arrays(JOINT_REFERENCE, JOINTS)
        begin = time.process_time()
        for k, (position, velocity, effort) in enumerate(values):
            stamp = 10**18 + k * STEP
            states.write(stamp, stamp, position, velocity, effort)
            pressures.write(stamp, stamp, position[1:], velocity[1:], 2e7, np.nan)
            commands.write(stamp, stamp, position)
            references.write(stamp, stamp, position, velocity, effort)
        written = (time.process_time() - begin) / (4 * count) * 1e6
    read_topics(tmp_path / "bag", TOPICS)  # compiles
    begin = time.process_time()
    data = read_topics(tmp_path / "bag", TOPICS)
    read = (time.process_time() - begin) / (4 * count)
    assert sum(len(one.stamp) for one in data.values()) == 4 * count
    store = typestore()
    begin = time.process_time()
    with Reader(tmp_path / "bag") as bag:
        for connection, _, message in bag.messages():
            store.deserialize_cdr(message, connection.msgtype)
    peer = (time.process_time() - begin) / (4 * count)
    print(
        f"\nbag: {written:.1f} us to write a message; to arrays {1e-3 / read:.0f} thousand "
        f"messages/s, rosbags message by message {1e-3 / peer:.0f} thousand/s"
    )
    measured(
        "bags to arrays; rosbags' own deserialisation",
        "300 thousand messages/s",
        "{ours:.0f}; {rosbags:.0f} thousand messages/s",
        ours=1e-3 / read,
        rosbags=1e-3 / peer,
    )
    assert read < 1 / 300e3
    assert written < 25
    assert peer > 5 * read


def test_velocity_filter_of_four_joints() -> None:
    count = 20_000
    positions = np.random.default_rng(0).normal(size=(count, 4))
    velocity_filter = VelocityFilter([1e-3] * 4, [1e-4] * 4)
    velocity_filter.update(0.0, positions[0])  # compiles
    begin = time.process_time()
    for k in range(1, count):
        velocity_filter.update(k * 0.005, positions[k])
    each = (time.process_time() - begin) / count * 1e6
    print(f"\nvelocity filter: {each:.1f} us an update of four joints")
    assert each < 20
