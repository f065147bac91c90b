"""Bags cut off anywhere: everything whole before the cut is saved, the bag itself not touched."""

import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader, StoragePlugin

from crane_bags import read_topics
from crane_bags.types import JOINT_STATES
from crane_model import DataError
from crane_nodes.recording.bag import RecordedTopic, Split
from crane_nodes.recording.recover import Salvage, main, recover

Recorder = Callable[..., Path]
COUNT, FLUSH = 200, 20


def positions(bag: Path) -> list[float]:
    data = read_topics(bag, [JOINT_STATES])[JOINT_STATES.name]
    return data.fields["position"][:, 0].tolist()


def saved(file: Path) -> list[int]:
    """Sequence numbers of the messages that can be saved."""
    return [message.sequence for _, message in Salvage(file)]


@pytest.fixture
def content(tmp_path: Path, record: Recorder) -> bytes:
    """A closed mcap file of COUNT messages in chunks of FLUSH."""
    return (record(COUNT, name="whole", flush=FLUSH) / "whole_0.mcap").read_bytes()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_cut_anywhere(share: float, content: bytes, tmp_path: Path) -> None:
    """What is saved is the beginning, to the last byte that can be used."""
    cut = 8 + round(share * (len(content) - 8))
    file = tmp_path / "cut.mcap"
    file.write_bytes(content[:cut])
    found = saved(file)
    assert found == list(range(1, len(found) + 1))
    message = re.compile(rb"\x05.\x00\x00\x00\x00\x00\x00\x00\x01\x00", re.DOTALL)  # channel 1
    begins = [one.start() for one in message.finditer(content)]
    assert len(begins) == COUNT
    whole = sum(begin + 9 + content[begin + 1] <= cut for begin in begins)
    assert len(found) == whole


def test_noise_costs_its_chunk(content: bytes, tmp_path: Path) -> None:
    middle = len(content) // 2
    file = tmp_path / "noise.mcap"
    file.write_bytes(content[:middle] + b"\xff" * 8 + content[middle + 8 :])
    salvage = Salvage(file)
    found = [message.sequence for _, message in salvage]
    lost = sorted(set(range(1, COUNT + 1)) - set(found))
    assert len(lost) == FLUSH
    assert lost == list(range(lost[0], lost[0] + FLUSH))
    (note,) = salvage.notes
    assert re.search(r"noise.mcap: record at byte \d+ left out: crc validation failed", note)


def test_file_that_ends_in_zeros(content: bytes, tmp_path: Path) -> None:
    """As a loss of power may leave it."""
    file = tmp_path / "zeros.mcap"
    half = content[: len(content) // 2]
    file.write_bytes(half)
    before = saved(file)
    file.write_bytes(half + bytes(10_000))
    found = saved(file)
    assert found == before[: len(found)]
    assert len(before) - FLUSH < len(found)


def test_closed_file_is_saved_whole(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "whole.mcap"
    file.write_bytes(content)
    salvage = Salvage(file)
    assert [message.sequence for _, message in salvage] == list(range(1, COUNT + 1))
    assert salvage.notes == []


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"SQLite format 3\0"])
def test_other_files_are_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(content)
    with pytest.raises(DataError, match="bag.mcap: not an mcap file"):
        saved(file)


def test_recovered_bag_is_a_bag(record: Recorder, tmp_path: Path, topic: RecordedTopic) -> None:
    damaged = record(2500, close=False, split=Split(duration=1.0))
    before = {file.name: file.read_bytes() for file in damaged.iterdir()}
    assert len(before) == 13  # more than ten: they are in the order of their numbers
    report = recover(damaged, tmp_path / "mended")
    assert positions(tmp_path / "mended") == [float(k) for k in range(2500)]
    assert {file.name: file.read_bytes() for file in damaged.iterdir()} == before
    assert "/joint_states  sensor_msgs/msg/JointState      2500" in report
    assert "bag_12.mcap was not closed" in report
    assert "bag_11.mcap" not in report
    with Reader(tmp_path / "mended") as reader:
        assert len(reader.storage.storages) == 13
        (stated,) = reader.connections
        assert stated.digest == topic.definition.type_hash
        assert tuple(stated.ext.offered_qos_profiles) == topic.offered_qos


def test_one_file_is_recovered(record: Recorder, tmp_path: Path) -> None:
    damaged = record(100, close=False) / "bag_0.mcap"
    recover(damaged, tmp_path / "mended")
    assert positions(tmp_path / "mended") == [float(k) for k in range(100)]


@pytest.mark.parametrize("cut", [0, 1000])
def test_bag_of_rosbags(
    cut: int,
    write_bag: Callable[..., Path],
    joint_state: Callable[..., bytes],
    tmp_path: Path,
    topic: RecordedTopic,
) -> None:
    """Its files state no type hashes and no checksums, and it was one chunk."""
    path = write_bag([(k, joint_state(k, ["slew"], [float(k)])) for k in range(500)])
    file = path / "bag.mcap"
    whole = file.read_bytes()
    end_of_chunk = whole.index(b"\x07", whole.rindex(b"slew"))
    if cut:
        file.write_bytes(whole[: end_of_chunk - cut])
    (path / "metadata.yaml").unlink()
    recover(path, tmp_path / "mended")
    found = positions(tmp_path / "mended")
    assert found == [float(k) for k in range(len(found))]
    assert len(found) == 500 if cut == 0 else 480 < len(found) < 500
    with Reader(tmp_path / "mended") as reader:
        assert reader.connections[0].digest == topic.definition.type_hash


def test_nothing_is_made_where_nothing_is_saved(
    record: Recorder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = record(10, close=False)  # nothing was flushed
    assert main([str(damaged), "--out", str(tmp_path / "mended")]) == 1
    assert f"error: {damaged}: holds no whole message (bag_0.mcap was" in capsys.readouterr().err
    assert not (tmp_path / "mended").exists()


def test_damaged_bag_is_never_written_to(record: Recorder, tmp_path: Path) -> None:
    damaged = record(100, close=False)
    for out in (damaged / "mended", tmp_path / "bag" / ".." / "bag" / "deep" / "mended"):
        with pytest.raises(DataError, match="would change the damaged bag"):
            recover(damaged, out)
    with pytest.raises(DataError, match="cannot make a bag here"):
        recover(damaged, damaged)


@pytest.mark.parametrize("metadata", [True, False])
def test_sqlite_bag_with_a_write_ahead_log(
    metadata: bool,
    write_bag: Callable[..., Path],
    joint_state: Callable[..., bytes],
    tmp_path: Path,
) -> None:
    """As a recorder leaves it that was killed: a third of the messages is in the log only."""
    path = write_bag(
        [(k, joint_state(k, ["slew"], [float(k)])) for k in range(200)], StoragePlugin.SQLITE3
    )
    killed = tmp_path / "killed"
    killed.mkdir()
    with closing(sqlite3.connect(path / "bag.db3")) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)",
            [(k, joint_state(k, ["slew"], [float(k)])) for k in range(200, 300)],
        )
        database.commit()
        for file in path.iterdir():  # before SQLite closes it
            shutil.copy(file, killed)
    if not metadata:
        (killed / "metadata.yaml").unlink()
    before = {file.name: file.read_bytes() for file in killed.iterdir()}
    for opened in (killed, killed / "bag.db3"):  # half a bag is never taken for the whole
        with pytest.raises(DataError, match=f"bag.db3-wal holds messages.* recover {opened} --out"):
            read_topics(opened, [JOINT_STATES])
    for number, opened in enumerate((killed, killed / "bag.db3")):
        report = recover(opened, tmp_path / f"mended_{number}")
        assert positions(tmp_path / f"mended_{number}") == [float(k) for k in range(300)]
        assert "bag.db3 was not closed: bag.db3-wal read too" in report
    assert {file.name: file.read_bytes() for file in killed.iterdir()} == before


def test_sqlite_bag_without_metadata(
    write_bag: Callable[..., Path], joint_state: Callable[..., bytes], tmp_path: Path
) -> None:
    path = write_bag([(1, joint_state(1, ["slew"], [7.0]))], StoragePlugin.SQLITE3)
    (path / "metadata.yaml").unlink()
    with pytest.raises(DataError, match=f"no metadata.yaml; repair it: .* recover {path} --out"):
        read_topics(path, [JOINT_STATES])
    recover(path, tmp_path / "mended")
    assert positions(tmp_path / "mended") == [7.0]


def test_sqlite_file_that_is_none_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bag.db3"
    file.write_bytes(b"SQLite format 3\0" + bytes(100))
    with pytest.raises(DataError, match="bag.db3: nothing can be recovered"):
        recover(file, tmp_path / "mended")


@pytest.mark.parametrize("name", ["absent", "."])
def test_path_that_is_no_bag(name: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no .mcap or .db3 file here"):
        recover(tmp_path / name, tmp_path.parent / "mended")
