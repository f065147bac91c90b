"""Opening bags of either storage, single or split, and saying what is wrong with the others."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from os import SEEK_END
from pathlib import Path
from typing import NamedTuple, cast

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader, Statistics
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from crane_bags.chunks import BLOCK, Block, chunk_blocks, gathered
from crane_model.errors import DataError

STORAGE_SUFFIXES = (".mcap", ".db3")
Storage = McapReader | Sqlite3Reader
MCAP_MAGIC = b"\x89MCAP0\r\n"
UNKNOWN_TYPE = "__schemaless__"  # what rosbags calls a type that the summary does not repeat
SQLITE_LOGS = ("-wal", "-journal")  # what SQLite keeps beside a file until it is closed


class Count(NamedTuple):
    """How many messages of a topic metadata.yaml states, and how many its files hold."""

    stated: int
    held: int


class StoredBag(Reader):
    """An open bag, of which the files decide: metadata.yaml and the index of a file may be wrong.

    `contradictions`: topics of which the files hold more messages than metadata.yaml states.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self.contradictions: dict[str, Count] = {}

    def open(self) -> None:
        """Open the files, and find what they hold."""
        super().open()
        for file in _storages(self):
            if isinstance(file, McapReader):
                _read_on(file)
        if isinstance(self.storage, DirectoryReader):
            self._compare(self.storage)

    @property
    def held(self) -> int:
        """Number of messages in the files."""
        return sum(one.msgcount for file in _storages(self) for one in file.connections)

    def _compare(self, folder: DirectoryReader) -> None:
        """Correct what metadata.yaml states of `folder` where the files hold more."""
        stored = [one for file in _storages(self) for one in file.connections]
        for topic in dict.fromkeys(one.topic for one in stored):
            held = sum(one.msgcount for one in stored if one.topic == topic)
            stated = [k for k, one in enumerate(folder.connections) if one.topic == topic]
            count = Count(sum(folder.connections[k].msgcount for k in stated), held)
            if count.held <= count.stated:
                continue
            self.contradictions[topic] = count
            if stated:
                first = folder.connections[stated[0]]
                more = first.msgcount + count.held - count.stated
                folder.connections[stated[0]] = first._replace(msgcount=more)
            else:
                new = next(one for one in stored if one.topic == topic)
                folder.connections.append(new._replace(msgcount=count.held))


def _read_on(file: McapReader) -> None:
    """Find in the data section what the summary of an mcap file does not repeat: channels,
    schemas, and how many messages there are of each.
    """
    statistics = file.statistics
    counted = sum(one.msgcount for one in file.connections)
    if (
        statistics is not None
        and counted == statistics.message_count
        and (counted or not file.chunks)
        and all(one.msgtype != UNKNOWN_TYPE for one in file.connections)
    ):
        return
    file.schemas.clear()
    file.channels.clear()
    file.connections.clear()
    file.meta_scan()
    if not any(one.channel_count for one in file.chunks):
        file.chunks.clear()  # so that rosbags looks for messages without them
    found = cast(Statistics, file.statistics).channel_message_counts
    file.connections[:] = [one._replace(msgcount=found.get(one.id, 0)) for one in file.connections]


@contextmanager
def open_bag(path: Path) -> Iterator[StoredBag]:
    """The open bag: a folder with metadata.yaml, or one .mcap or .db3 file of it.

    `DataError` if it is absent, not a bag, damaged, not closed properly or empty.
    """
    _check_kind(path)
    with _damage(path):
        reader = StoredBag(path)
        reader.open()
    try:
        if reader.message_count == 0 and reader.held == 0:
            raise DataError(f"{path}: the bag is empty; record again and check the publishers")
        yield reader
    finally:
        reader.close()


def messages(
    path: Path, reader: Reader, topics: Collection[str]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Connection, log time [ns] and CDR of each message of `topics`, in order of log time.

    `DataError` where the storage is damaged.
    """
    sources = [one for name in topics for one in connections(reader, name)]
    if sources:  # to rosbags, none means all
        with _damage(path):
            yield from reader.messages(sources)


def blocks(path: Path, reader: Reader, topics: Collection[str]) -> Iterator[Block]:
    """All messages of `topics`, those of each topic in the order of the files, as they arrived.

    `DataError` where the storage is damaged.
    """
    with _damage(path):
        if reader.compression_mode != "message":
            for storage in _storages(reader):
                yield from _file_blocks(storage, topics)
        elif sources := [one for name in topics for one in connections(reader, name)]:
            messages = reader.messages(sources)
            yield from _by_topic((one.topic, time, data) for one, time, data in messages)


def _file_blocks(storage: Storage, topics: Collection[str]) -> Iterator[Block]:
    wanted = {one.id: one.topic for one in storage.connections if one.topic in topics}
    if isinstance(storage, McapReader):
        yield from chunk_blocks(Path(str(storage.path)), wanted)
    elif wanted:
        numbers = ",".join(map(str, wanted))
        assert storage.dbconn is not None  # the storage is open
        rows = storage.dbconn.execute(
            f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({numbers}) "
            "ORDER BY id"  # rosbags sorts by log time, which hides a clock that goes back
        )
        yield from _by_topic((wanted[number], time, data) for number, time, data in rows)


def _by_topic(messages: Iterator[tuple[str, int, bytes]]) -> Iterator[Block]:
    pending: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    for topic, log_time, data in messages:
        pending[topic].append((log_time, data))
        if len(pending[topic]) == BLOCK:
            yield gathered(topic, pending.pop(topic))
    for topic, found in pending.items():
        yield gathered(topic, found)


def connections(reader: Reader, topic: str) -> list[Connection]:
    """The connections of a topic as the storage files state them.

    Those of `reader.connections` come from metadata.yaml, and rosbags silently drops every message
    where the two state different QoS profiles, as bags out of `ros2 bag convert` do.
    """
    return [one for file in _storages(reader) for one in file.connections if one.topic == topic]


def announced(reader: Reader, topic: str) -> tuple[int, set[str]]:
    """Number of messages and type hashes (where given) that a bag states for a topic."""
    stated = [one for one in reader.connections if one.topic == topic]
    hashes = {one.digest for one in stated if (one.digest or "").startswith("RIHS01_")}
    return sum(one.msgcount for one in stated), hashes


def _storages(reader: Reader) -> list[Storage]:
    storage = reader.storage
    storages = storage.storages if isinstance(storage, DirectoryReader) else [storage]
    return cast(list[Storage], storages)


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Turns whatever rosbags raises on a damaged file into an error that says so."""
    try:
        yield
    except Exception as error:  # not only errors of its own: parsers stumble over anything
        raise DataError(f"{path}: {_explain(path, error)}") from error


def _check_kind(path: Path) -> None:
    if not path.exists():
        raise DataError(f"{path}: no such bag; check the path")
    for file in _storage_files(path):
        for log in unfinished(file):
            raise DataError(
                f"{path}: the bag was not closed properly: {log.name} holds messages that "
                f"{file.name} does not; {_remedy(path)}"
            )
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return
        if files := _storage_files(path):
            raise DataError(
                f"{path}: the bag was not closed properly: {files[0].name} is there, but no "
                f"metadata.yaml; {_remedy(path)}"
            )
    elif path.suffix in STORAGE_SUFFIXES:
        return
    raise DataError(
        f"{path}: not a bag; name a folder with metadata.yaml or a file that ends in "
        f"{' or '.join(STORAGE_SUFFIXES)}"
    )


def unfinished(file: Path) -> list[Path]:
    """Logs beside a .db3 file whose content is not in it: whoever wrote it did not close it."""
    logs = [file.with_name(file.name + ending) for ending in SQLITE_LOGS]
    return [log for log in logs if log.exists() and log.stat().st_size > 0]


def _storage_files(path: Path) -> Sequence[Path]:
    files = path.iterdir() if path.is_dir() else [path]
    return sorted(file for file in files if file.suffix in STORAGE_SUFFIXES)


def _explain(path: Path, error: Exception) -> str:
    for file in _storage_files(path):
        if not _closed(file):
            return f"the bag was not closed properly: {file.name} has no end; {_remedy(path)}"
    return f"the bag is damaged or incomplete: {error or type(error).__name__}; copy it again"


def _remedy(path: Path) -> str:
    """What to do about a bag whose recorder was killed, or is still at work."""
    folder = path if path.is_dir() else path.with_suffix("")
    return f"mend it: ros2 run crane_nodes recover {path} --out {folder}_recovered"


def _closed(file: Path) -> bool:
    """False for an mcap file that was begun and not ended."""
    with file.open("rb") as content:
        if content.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            return True
        content.seek(-len(MCAP_MAGIC), SEEK_END)
        return content.tell() > 0 and content.read() == MCAP_MAGIC
