"""Bags of CAN frames, as ros2_socketcan records them, are logs as all others."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from crane_driver.can.log_formats import open_log
from crane_driver.decode import main
from crane_identification.check_recording import main as check_recording
from crane_model import DataError

START = 1_700_000_000_000_000_000  # ns
HEADER = "std_msgs/Header header\nuint32 id\n"
TYPES = {
    "can_msgs/msg/Frame": f"{HEADER}bool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\n"
    "uint8[8] data\n",
    "ros2_socketcan_msgs/msg/FdFrame": f"{HEADER}bool is_extended\nbool is_error\nuint8 len\n"
    "uint8[<=64] data\n",
}


def record(
    path: Path,
    frames: Sequence[tuple[str, dict[str, Any]]],
    storage: StoragePlugin = StoragePlugin.MCAP,
    msgtype: str = "can_msgs/msg/Frame",
    clock: Sequence[int] | None = None,
) -> Path:
    """A bag of the frames (topic and fields), received 1 ms after their stamps.

    `clock`: stamp of each in 10 ms; None: one after the other.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TYPES[msgtype], msgtype))
    header, time = (
        store.types[f"{one}"] for one in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with Writer(path, version=9, storage_plugin=storage) as writer:
        topics = {
            topic: writer.add_connection(topic, msgtype, typestore=store)
            for topic in dict.fromkeys(topic for topic, _ in frames)
        }
        for number, (topic, fields) in enumerate(frames):
            stamp = START + 10_000_000 * (clock[number] if clock else number)
            values = {
                name: False for name in store.types[msgtype].__dataclass_fields__ if "is_" in name
            }
            stamped = header(time(sec=stamp // 10**9, nanosec=stamp % 10**9), "can0")
            message = store.types[msgtype](header=stamped, **{**values, **fields})
            writer.write(topics[topic], stamp + 1_000_000, store.serialize_cdr(message, msgtype))
    return path


def frame(value: int, identifier: int = 0x120, **fields: Any) -> dict[str, Any]:
    data = np.array([value, 2, 3, 0, 0, 0, 0, 0], np.uint8)
    return {"id": identifier, "dlc": 3, "data": data, **fields}


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("named", ["folder", "file"])
def test_frames_of_either_storage(storage: StoragePlugin, named: str, tmp_path: Path) -> None:
    frames = [
        frame(1),
        frame(2, 0x18FEF121, is_extended=True),
        frame(0, is_rtr=True),
        frame(0, is_error=True),
    ]
    bag = record(tmp_path / "bag", [("/from_can_bus", one) for one in frames], storage)
    path = bag if named == "folder" else next(bag.glob("bag*.[md]*"))
    log = open_log(path)
    assert [(one.id, one.extended, one.data, one.stamp - START) for one in log.frames()] == [
        (0x120, False, bytes((1, 2, 3)), 0),
        (0x18FEF121, True, bytes((2, 2, 3)), 10_000_000),
    ]
    assert (log.remote, log.errors) == (1, 1)


def test_frames_with_flexible_data_rate(tmp_path: Path) -> None:
    data = np.arange(12, dtype=np.uint8)
    bag = record(
        tmp_path / "bag",
        [("/from_can_bus_fd", {"id": 1, "len": 12, "data": data})],
        msgtype="ros2_socketcan_msgs/msg/FdFrame",
    )
    (found,) = open_log(bag).frames()
    assert found.data == data.tobytes()


def test_a_topic_is_a_channel(
    tmp_path: Path, write_dbc: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    topics = ("/left/from_can_bus", "/right/from_can_bus")
    bag = record(tmp_path / "bag", [(topics[n % 2], frame(n)) for n in range(6)])
    dbc = write_dbc({"Boom": (0x120, 3, 0, [("Angle", "0|8@1+ (1,0) [0|0]", "")])})
    out = tmp_path / "table.csv"
    arguments = ["--log", str(bag), "--dbc", str(dbc), "--out", str(out)]
    assert main(arguments) == 1
    assert f"channels {topics[0]} and {topics[1]}; say which one" in capsys.readouterr().err
    assert main([*arguments, "--channel", topics[1]]) == 0
    assert pl.read_csv(out)["value"].to_list() == [1.0, 3.0, 5.0]
    assert "also 3 frames of other channels" in capsys.readouterr().out


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_clock_that_goes_back_among_frames_is_told(
    storage: StoragePlugin, tmp_path: Path
) -> None:
    order = [0, 1, 2, 3, 0, 1, 2, 3]  # a bag that was played again
    path = tmp_path / "bag"
    bag = record(path, [("/from_can_bus", frame(n)) for n in order], storage, clock=order)
    log = open_log(bag)
    assert [one.data[0] for one in log.frames()] == order, "as they arrived"
    assert (log.set_back, log.furthest_back) == (1, 30_000_000)


def test_a_bag_of_something_else_is_refused(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9) as writer:
        topic = writer.add_connection("/said", "std_msgs/msg/String", typestore=store)
        said = store.types["std_msgs/msg/String"]("123#11")
        writer.write(topic, START, store.serialize_cdr(said, "std_msgs/msg/String"))
    with pytest.raises(DataError, match=r"no topic of type can_msgs/msg/Frame .*holds /said"):
        list(open_log(tmp_path / "bag").frames())
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="not a bag"):
        list(open_log(tmp_path / "empty").frames())


def test_recordings_of_frames_are_to_be_decoded_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = record(tmp_path / "bag", [("/from_can_bus", frame(1))])
    assert check_recording([str(bag)]) == 1
    said = capsys.readouterr().err
    assert (
        f"CAN frames on /from_can_bus; decode them first: ros2 run crane_driver decode --log {bag}"
        in said
    )
