"""Bags of machines with topics and message types of their own, through a column map."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from crane_identification import ColumnMap, Log, read_recording
from crane_model import CraneError

OWN = "own_msgs/msg/Valve"
OWN_DEFINITION = "std_msgs/Header header\nfloat32[2] spool\nown_msgs/Sensor[] sensors\n"
SENSOR, SENSOR_DEFINITION = "own_msgs/msg/Sensor", "int32 raw\nfloat64 degrees\n"
START = 1_700_000_000_000_000_000
STEP = 10_000_000
COUNT = 30

MAP = """
joints:
  boom:
    position: {topic: /encoders, field: position, index: b, unit: deg, scale: -1}
    pressure_a: {topic: /pressures, field: data, index: 1, unit: bar}
    pressure_b: {topic: /boom/rod, field: fluid_pressure, unit: Pa}
    command: {topic: /valve, field: spool, index: 0, unit: "%"}
temperature: {topic: /valve, field: sensors.1.degrees, unit: deg C, type: own_msgs/Valve}
"""


def mapped(text: str = MAP) -> ColumnMap:
    return ColumnMap.model_validate(yaml.safe_load(text))


def types() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(SENSOR_DEFINITION, SENSOR))
    store.register(get_types_from_msg(OWN_DEFINITION, OWN))
    return store


def messages(store: Typestore, number: int) -> dict[str, Any]:
    of = store.types
    seconds, nanoseconds = divmod(START + number * STEP, 10**9)
    stamp = of["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    header = of["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    layout = of["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    names = ["a", "b"] if number % 2 else ["b", "a"]  # as some drivers do
    position = np.array([np.nan, number] if number % 2 else [number, np.nan])
    empty = np.array([])
    sensors = [of[SENSOR](raw=number, degrees=value) for value in (0.0, 40.0)]
    return {
        "/encoders": of["sensor_msgs/msg/JointState"](
            header=header, name=names, position=position, velocity=empty, effort=empty
        ),
        "/pressures": of["std_msgs/msg/Float64MultiArray"](
            layout=layout, data=np.array([0.0, 10.0 + number, 0.0])
        ),
        "/boom/rod": of["sensor_msgs/msg/FluidPressure"](
            header=header, fluid_pressure=5e5, variance=0.0
        ),
        "/valve": of[OWN](header=header, spool=np.array([50, 0], np.float32), sensors=sensors),
    }


def write(path: Path, storage: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """Log times are 2 ms after the stamps; Float64MultiArray has none."""
    store = types()
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = {
            topic: writer.add_connection(topic, message.__msgtype__, typestore=store)
            for topic, message in messages(store, 0).items()
        }
        for number in range(COUNT):
            for topic, message in messages(store, number).items():
                data = store.serialize_cdr(message, message.__msgtype__)
                writer.write(connections[topic], START + number * STEP + 2_000_000, data)
    return path


def check(log: Log) -> None:
    time = np.arange(COUNT) / 100
    assert log.start == START
    np.testing.assert_allclose(log.position.time, time, atol=1e-12)
    np.testing.assert_allclose(log.position.value[:, 0], -np.radians(np.arange(COUNT)))
    assert log.pressure_a is not None
    np.testing.assert_allclose(log.pressure_a.time, time + 0.002, atol=1e-12)
    np.testing.assert_allclose(log.pressure_a.value[:, 0], 1e5 * (10 + np.arange(COUNT)))
    assert log.pressure_b is not None
    np.testing.assert_allclose(log.pressure_b.value, 5e5)
    assert log.command is not None
    np.testing.assert_allclose(log.command.value, 0.5)
    assert log.temperature is not None
    np.testing.assert_allclose(log.temperature.value, 40.0)
    assert log.notes == (f"/pressures: no header stamp, log time used ({COUNT})",)


@pytest.mark.parametrize("storage", StoragePlugin)
def test_topics_of_any_name_and_type(storage: StoragePlugin, tmp_path: Path) -> None:
    check(read_recording(write(tmp_path / "bag", storage), ["boom"], mapped()))


def test_the_recorder_is_the_clock_of_mapped_topics_too(tmp_path: Path) -> None:
    log = read_recording(write(tmp_path / "bag"), ["boom"], mapped())
    assert log.position.received is not None
    np.testing.assert_allclose(log.position.received - log.position.time, 0.002, atol=1e-9)
    assert log.unstamped == ("/pressures",)
    assert log.pressure_a is not None and log.pressure_a.received is None


def test_joints_of_different_topics_share_the_times_of_the_first(tmp_path: Path) -> None:
    columns = MAP.replace("temperature:", "#").replace("joints:\n", "") + "\n"
    boom = yaml.safe_load(columns)["boom"]
    stick = boom | {
        "position": {"topic": "/pressures", "field": "data", "index": 1, "unit": "rad"},
    }
    column_map = ColumnMap.model_validate({"joints": {"boom": boom, "stick": stick}})
    log = read_recording(write(tmp_path / "bag"), ["boom", "stick"], column_map)
    expected = 10 + np.arange(COUNT) - 0.2  # stamped 2 of 10 ms later
    np.testing.assert_allclose(log.position.value[1:, 1], expected[1:], atol=1e-6)
    assert np.isnan(log.position.value[0, 1])


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("topic: /encoders", "topic: /encoder", r"no message of topic /encoder; the bag holds .*"
         r"/boom/rod \(sensor_msgs/msg/FluidPressure\), /encoders \(sensor"),
        ("field: fluid_pressure", "field: pressure", "no field 'pressure'; there are header, fl"),
        ("data, index: 1", "data", "data holds 3 values; give the index of one, from 0"),
        ("data, index: 1", "data, index: 3", "no place 3 in an array of 3"),
        ("index: b", "index: c", r"position\[c\] never holds a number; its names are a, b"),
        ("unit: Pa", "unit: Pa, index: 0", "fluid_pressure holds a single value; take out the"),
        ("type: own_msgs/Valve", "type: std_msgs/Float64", "is of type own_msgs/msg/Valve, "
         "expected std_msgs/msg/Float64"),
        ("sensors.1.degrees", "sensors", "sensors holds 2 values; give the index of one"),
        ("sensors.1.degrees", "sensors.1", "no number, but .*Sensor; name a field of it"),
        ("sensors.1.degrees", "sensors.2.raw", "no place 2 in an array of 2"),
    ],
)  # fmt: skip
def test_mistakes_name_what_there_is(right: str, wrong: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CraneError, match=message) as error:
        read_recording(write(tmp_path / "bag"), ["boom"], mapped(MAP.replace(right, wrong)))
    assert str(tmp_path / "bag") in str(error.value)


def test_a_type_that_nobody_knows(tmp_path: Path) -> None:
    """Older bags of sqlite3 hold no definitions."""
    import sqlite3

    path = write(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM message_definitions")
    with pytest.raises(CraneError, match="does not define own_msgs/msg/Valve"):
        read_recording(path, ["boom"], mapped())


IDL = """================================================================================
IDL: own_msgs/msg/Level
module own_msgs { module msg { struct Level { float level; own_msgs::msg::Inner inner; }; }; };
================================================================================
IDL: own_msgs/msg/Inner
module own_msgs { module msg { struct Inner { double deep; }; }; };
"""
LEVEL = """
joints:
  boom:
    position: {topic: /level, field: level, unit: m}
    force: {topic: /level, field: inner.deep, unit: N}
"""


def write_levels(path: Path, definition: str) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 deep", "own_msgs/msg/Inner"))
    store.register(get_types_from_msg("float32 level\nInner inner", "own_msgs/msg/Level"))
    inner = store.types["own_msgs/msg/Inner"](deep=7.0)
    message = store.types["own_msgs/msg/Level"](level=0.5, inner=inner)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            "/level", "own_msgs/msg/Level", msgdef=definition, rihs01="RIHS01_" + "0" * 64
        )
        for number in range(COUNT):
            data = store.serialize_cdr(message, "own_msgs/msg/Level")
            writer.write(connection, START + number * STEP, data)
    return path


def test_definitions_in_idl(tmp_path: Path) -> None:
    log = read_recording(write_levels(tmp_path / "bag", IDL), ["boom"], mapped(LEVEL))
    assert log.force is not None
    np.testing.assert_array_equal(log.position.value, 0.5)
    np.testing.assert_array_equal(log.force.value, 7.0)


def test_definitions_that_are_not_whole(tmp_path: Path) -> None:
    path = write_levels(tmp_path / "bag", "float32 level\nown_msgs/Inner inner")
    with pytest.raises(CraneError, match="own_msgs/msg/Level in the bag .*own_msgs/msg/Inner"):
        read_recording(path, ["boom"], mapped(LEVEL))


def test_a_map_is_of_bags_or_of_tables(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text("x\n1\n")
    with pytest.raises(CraneError, match="the column map is for bags"):
        read_recording(table, ["boom"], mapped())
    columns = (
        "{rate: 1, joints: {boom: {position: {column: x, unit: m}, force: {column: f, unit: N}}}}"
    )
    with pytest.raises(CraneError, match="the column map is for tables"):
        read_recording(write(tmp_path / "bag"), ["boom"], mapped(columns))
    with pytest.raises(ValueError, match="take out time and rate"):
        mapped(MAP + "rate: 100\n")
    with pytest.raises(ValueError, match="write a map for each"):
        mapped(MAP + "slew_position: {column: q1, unit: rad}\n")
