from pathlib import Path

import numpy as np
import pytest
from laboratory_crane import JOINTS, PLANAR_JOINTS

from crane_bags import BagWriter, Topic
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    VALVE_OUTPUT,
)
from crane_identification import read_bag
from crane_model import DataError

START = 1_700_000_000_000_000_000
STEP = 5_000_000
COUNT = 30
POSITION = np.random.default_rng(2).normal(size=(COUNT, 4))
PRESSURE = 1e6 * np.random.default_rng(3).uniform(size=(COUNT, 2, 3))


def write(
    path: Path,
    joints: tuple[str, ...] = JOINTS,
    commands: bool = False,
    namespaces: tuple[str, ...] = ("/",),
    told_on: Topic = VALVE_COMMAND,
) -> Path:
    """Pressures come 2 ms after the positions; commands every third time. The positions of the
    crane in each further namespace are 1 larger.
    """
    with BagWriter(path) as bag:
        for further, namespace in enumerate(namespaces):
            states = bag.add_arrays(JOINT_STATES.within(namespace), joints)
            pressures = bag.add_arrays(CYLINDER_PRESSURES.within(namespace), PLANAR_JOINTS)
            if commands:
                command = bag.add_arrays(told_on.within(namespace), JOINTS)
                reference = bag.add_arrays(JOINT_REFERENCE.within(namespace), JOINTS)
            for k in range(COUNT):
                stamp = START + k * STEP
                position = POSITION[k, [JOINTS.index(joint) for joint in joints]] + further
                states.write(stamp + 9, stamp, position, -position, np.full(len(joints), np.nan))
                late = stamp + 2_000_000
                pressures.write(late + 9, late, PRESSURE[k, 0], PRESSURE[k, 1], 17e6, np.nan)
                if commands and k % 3 == 0:
                    command.write(stamp, stamp, np.full(4, k / COUNT))
                    reference.write(stamp, stamp, position, 2 * position, 3 * position)
    return path


def test_signals_keep_their_own_stamps(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag", commands=True), PLANAR_JOINTS)
    assert log.start == START
    assert log.joints == PLANAR_JOINTS
    np.testing.assert_allclose(log.position.time, np.arange(COUNT) * 0.005, atol=1e-12)
    np.testing.assert_array_equal(log.position.value, POSITION[:, 1:])
    assert log.velocity is not None
    np.testing.assert_array_equal(log.velocity.value, -POSITION[:, 1:])
    assert log.slew_position is not None
    np.testing.assert_array_equal(log.slew_position.value, POSITION[:, 0])
    assert log.pressure_a is not None
    assert log.pressure_b is not None
    np.testing.assert_allclose(log.pressure_a.time, np.arange(COUNT) * 0.005 + 0.002, atol=1e-12)
    np.testing.assert_array_equal(log.pressure_a.value, PRESSURE[:, 0])
    np.testing.assert_array_equal(log.pressure_b.value, PRESSURE[:, 1])
    assert log.supply_pressure is not None
    np.testing.assert_array_equal(log.supply_pressure.value, 17e6)
    assert log.tank_pressure is None
    assert log.command is not None
    np.testing.assert_allclose(log.command.time, np.arange(0, COUNT, 3) * 0.005, atol=1e-12)
    assert log.reference_acceleration is not None
    np.testing.assert_array_equal(log.reference_acceleration.value, 3 * POSITION[::3, 1:])
    assert log.missing == ()
    assert log.notes == ()


def test_a_recording_of_a_driver_that_only_listens_has_commands(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag", commands=True, told_on=VALVE_OUTPUT), PLANAR_JOINTS)
    assert log.command is not None
    assert log.command.origin == VALVE_OUTPUT.name
    np.testing.assert_allclose(log.command.value[:, 0], np.arange(0, COUNT, 3) / COUNT)
    assert log.missing == ()


def test_the_bag_of_a_crane_in_a_namespace_is_read_without_being_told(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag", commands=True, namespaces=("/left",)), PLANAR_JOINTS)
    np.testing.assert_array_equal(log.position.value, POSITION[:, 1:])
    assert log.position.origin == "/left/joint_states"
    assert log.pressure_a is not None
    assert log.command is not None
    assert log.reference_position is not None
    assert log.missing == ()


def test_of_two_cranes_in_a_bag_the_one_that_is_named_is_read(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", namespaces=("/left", "/site/right"))
    with pytest.raises(DataError, match="2 cranes, in the namespaces /left, /site/right; say"):
        read_bag(bag, PLANAR_JOINTS)
    log = read_bag(bag, PLANAR_JOINTS, namespace="/site/right")
    np.testing.assert_array_equal(log.position.value, POSITION[:, 1:] + 1.0)
    with pytest.raises(DataError, match="no topic /middle/joint_states; the bag holds"):
        read_bag(bag, PLANAR_JOINTS, namespace="/middle")


def test_a_crane_in_the_root_goes_before_those_in_namespaces(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag", namespaces=("/left", "/")), PLANAR_JOINTS)
    np.testing.assert_array_equal(log.position.value, POSITION[:, 1:] + 1.0)


def test_signals_say_when_the_recorder_received_them(tmp_path: Path) -> None:
    """So that the clocks of topics can be compared: header against log time."""
    log = read_bag(write(tmp_path / "bag"), PLANAR_JOINTS)
    for signal in (log.position, log.pressure_a, log.slew_position):
        assert signal is not None
        assert signal.received is not None
        np.testing.assert_allclose(signal.received - signal.time, 9e-9, atol=1e-12)


def test_columns_follow_the_joints_of_the_model(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag"), ["telescope", "inner_boom"])
    np.testing.assert_array_equal(log.position.value, POSITION[:, [3, 1]])
    assert log.pressure_a is not None
    np.testing.assert_array_equal(log.pressure_a.value, PRESSURE[:, 0][:, [2, 0]])


def test_missing_topics_are_named_and_slew_is_optional(tmp_path: Path) -> None:
    log = read_bag(write(tmp_path / "bag", joints=PLANAR_JOINTS), PLANAR_JOINTS)
    assert log.missing == ("/valve_command", "/joint_reference")
    assert log.command is log.reference_position is log.slew_position is None


def test_joint_without_pressure_transducers(tmp_path: Path) -> None:
    path = write(tmp_path / "bag")
    with pytest.raises(DataError, match="topic /cylinder_pressures has no slew; it has inner_b"):
        read_bag(path, JOINTS)


def write_states(path: Path, effort: np.ndarray) -> Path:
    with BagWriter(path) as bag:
        states = bag.add_arrays(JOINT_STATES, JOINTS)
        for k, row in enumerate(effort):
            stamp = START + k * STEP
            states.write(stamp, stamp, POSITION[k], -POSITION[k], row)
    return path


def test_effort_is_the_force_where_no_pressures_were_recorded(tmp_path: Path) -> None:
    effort = np.random.default_rng(4).normal(size=(COUNT, 4))
    effort[:, 0] = np.nan  # the slew has no pressures
    log = read_bag(write_states(tmp_path / "bag", effort), PLANAR_JOINTS)
    assert log.force is not None
    np.testing.assert_array_equal(log.force.value, effort[:, 1:])
    assert log.pressure_a is log.pressure_b is log.supply_pressure is None
    assert "/cylinder_pressures" in log.missing
    assert any(
        "the effort of /joint_states is taken as the force" in warning for warning in log.warnings
    )


@pytest.mark.parametrize("count", [1, COUNT])
def test_bag_without_pressures_and_effort(count: int, tmp_path: Path) -> None:
    path = write_states(tmp_path / "bag", np.full((count, 4), np.nan))
    with pytest.raises(DataError, match="no topic /cylinder_pressures, and /joint_states holds no"):
        read_bag(path, PLANAR_JOINTS)
