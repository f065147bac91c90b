"""Opening bags of either storage, single or split, and saying what is wrong with the others."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import SEEK_END
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, McapRecord, Message
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from numba import njit
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader, zstd
from rosbags.rosbag2.storage_mcap import McapReader, Statistics
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

RECORD_HEADER_BYTES, MESSAGE_HEADER_BYTES = (
    9,
    22,
)  # bytes in front of the content of a record, and of the CDR of a message
BLOCK_MESSAGES = 4096  # messages that are gathered where they do not come by chunk
STORAGE_SUFFIXES = (".mcap", ".db3")
Storage = McapReader | Sqlite3Reader
MCAP_MAGIC = b"\x89MCAP0\r\n"
UNKNOWN_TYPE = "__schemaless__"  # what rosbags calls a type that the summary does not repeat
SQLITE_LOGS = ("-wal", "-journal")  # what SQLite keeps beside a file until it is closed


class Block(NamedTuple):
    """Messages of one topic, in the order of the file."""

    topic: str
    log_times: Sequence[int]  # ns
    messages: Sequence[bytes]  # CDR


class Count(NamedTuple):
    """How many messages of a topic metadata.yaml states, and how many its files hold."""

    stated: int
    held: int


class StoredBag(Reader):
    """An open bag, of which the files decide: metadata.yaml and the index of a file may be wrong.

    `contradictions`: topics of which the files hold another number than metadata.yaml states.
    `unlisted`: files of the folder that it does not list, which are not read.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self.folder = path
        self.contradictions: dict[str, Count] = {}
        self.unlisted: tuple[str, ...] = ()

    def open(self) -> None:
        """Open the files, and find what they hold."""
        super().open()
        for file in _storages(self):
            if isinstance(file, McapReader):
                _read_on(file)
        if isinstance(self.storage, DirectoryReader):
            self._compare(self.storage)
            listed = {Path(str(file.path)).name for file in _storages(self)}
            there = {file.name for file in _storage_files(self.folder)}
            self.unlisted = tuple(sorted(there - listed))

    @property
    def held(self) -> int:
        return sum(
            connection.msgcount for file in _storages(self) for connection in file.connections
        )

    def _compare(self, folder: DirectoryReader) -> None:
        """Correct what metadata.yaml states of `folder`: types and counts."""
        stored = [connection for file in _storages(self) for connection in file.connections]
        for topic in dict.fromkeys(found.topic for found in (*stored, *folder.connections)):
            held = sum(connection.msgcount for connection in stored if connection.topic == topic)
            stated = [
                k for k, connection in enumerate(folder.connections) if connection.topic == topic
            ]
            file = next((found for found in stored if found.topic == topic), None)
            for k in stated:
                if file and folder.connections[k].msgtype != file.msgtype:
                    folder.connections[k] = folder.connections[k]._replace(
                        msgtype=file.msgtype, msgdef=file.msgdef, digest=file.digest
                    )
            count = Count(sum(folder.connections[k].msgcount for k in stated), held)
            if count.held == count.stated:
                continue
            self.contradictions[topic] = count
            for k in stated:
                held = count.held if k == stated[0] else 0
                folder.connections[k] = folder.connections[k]._replace(msgcount=held)
            if file and not stated:
                folder.connections.append(file._replace(msgcount=count.held))


def _read_on(file: McapReader) -> None:
    """Find in the data section channels, schemas and counts that the mcap summary lacks."""
    statistics = file.statistics
    counted = sum(connection.msgcount for connection in file.connections)
    if (
        statistics is not None
        and counted == statistics.message_count
        and (counted or not file.chunks)
        and all(connection.msgtype != UNKNOWN_TYPE for connection in file.connections)
    ):
        return
    file.schemas.clear()
    file.channels.clear()
    file.connections.clear()
    file.meta_scan()
    if not any(chunk.channel_count for chunk in file.chunks):
        file.chunks.clear()  # so that rosbags looks for messages without them
    found = cast(Statistics, file.statistics).channel_message_counts
    file.connections[:] = [
        connection._replace(msgcount=found.get(connection.id, 0)) for connection in file.connections
    ]


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
    sources = [connection for name in topics for connection in connections(reader, name)]
    if sources:  # to rosbags, none means all
        with _damage(path):
            yield from reader.messages(sources)


def blocks(
    path: Path, reader: Reader, topics: Collection[str], progress: Progress = silent
) -> Iterator[Block]:
    """All messages of `topics`, those of each topic in the order of the files, as they arrived.

    `progress` is told the share of them. `DataError` where the storage is damaged.
    """
    done, total = 0, sum(c.msgcount for topic in topics for c in connections(reader, topic))
    with _damage(path):
        # metadata.yaml may list them in another order: bag_10 before bag_2
        for storage in sorted(_storages(reader), key=lambda storage: storage.metadata.start_time):
            for block in _file_blocks(storage, topics):
                yield _plain(block) if reader.compression_mode == "message" else block
                done += len(block.messages)
                progress(f"reading {path.name}", min(done / max(total, 1), 1.0))


def _plain(block: Block) -> Block:
    """A block whose messages were compressed one by one."""
    return block._replace(messages=[zstd.decompress(data) for data in block.messages])


def _file_blocks(storage: Storage, topics: Collection[str]) -> Iterator[Block]:
    wanted = {
        connection.id: connection.topic
        for connection in storage.connections
        if connection.topic in topics
    }
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
        if len(pending[topic]) == BLOCK_MESSAGES:
            yield gathered(topic, pending.pop(topic))
    for topic, found in pending.items():
        yield gathered(topic, found)


def connections(reader: Reader, topic: str) -> list[Connection]:
    """The connections of a topic as the storage files state them.

    Those of `reader.connections` come from metadata.yaml, and rosbags silently drops every message
    where the two state different QoS profiles, as bags out of `ros2 bag convert` do.
    """
    return [
        connection
        for file in _storages(reader)
        for connection in file.connections
        if connection.topic == topic
    ]


def announced(reader: Reader, topic: str) -> tuple[int, set[str]]:
    """Number of messages and type hashes (where given) that a bag states for a topic."""
    stated = [connection for connection in reader.connections if connection.topic == topic]
    hashes = {
        connection.digest
        for connection in stated
        if (connection.digest or "").startswith("RIHS01_")
    }
    return sum(connection.msgcount for connection in stated), hashes


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
                f"{file.name} does not; {remedy(path)}"
            )
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return
        if files := _storage_files(path):
            raise DataError(
                f"{path}: the bag was not closed properly: {files[0].name} is there, but no "
                f"metadata.yaml; {remedy(path)}"
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
            return f"the bag was not closed properly: {file.name} has no end; {remedy(path)}"
    if isinstance(error, KeyError) and MCAP_MAGIC in map(_magic, _storage_files(path)):
        return (
            f"a topic has a schema of the kind {error}, and topics of ROS 2 have ros2msg or "
            "ros2idl; keep those alone: mcap filter BAG.mcap -o OUT.mcap --include-topic-regex ..."
        )
    if "Profile is not" in str(error):
        return f"the header of the file does not say that it is of ROS 2; {remedy(path)}"
    held = [file.name for file in _storage_files(path)]
    if path.is_dir() and held and "files are missing" in str(error):
        return (
            f"metadata.yaml names files that are not there ({error}); the folder holds "
            f"{', '.join(held)}: give it the name that is stated, or name the file itself: "
            f"{path / held[0]}"
        )
    return f"the bag is damaged or incomplete: {error or type(error).__name__}; copy it again"


def remedy(path: Path) -> str:
    """Remedy for a bag whose recorder was killed, or is still at work."""
    folder = path if path.is_dir() else path.with_suffix("")
    return f"repair it: ros2 run crane_nodes recover {path} --out {folder}_recovered"


def _magic(file: Path) -> bytes:
    with file.open("rb") as content:
        return content.read(len(MCAP_MAGIC))


def _closed(file: Path) -> bool:
    """False for an mcap file that was begun and not ended."""
    with file.open("rb") as content:
        if content.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            return True
        content.seek(-len(MCAP_MAGIC), SEEK_END)
        return content.tell() > 0 and content.read() == MCAP_MAGIC


class _DataReader(StreamReader):
    """Passes over indexes of messages: to parse them takes as long as all else."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode != Opcode.MESSAGE_INDEX:
            return super()._read_record(opcode, length)
        self._stream.read(length)
        return None


def chunk_blocks(file: Path, topics: Mapping[int, str]) -> Iterator[Block]:
    """The messages of channels, whose `topics` are given by their numbers, as the file has them.

    The data section alone is read: an index may be absent, or may repeat no channels. Raises
    whatever the mcap library raises on a damaged file, a wrong checksum included.
    """
    loose: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with file.open("rb") as stream:
        for record in _DataReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                data, size = get_chunk_data_stream(record, validate_crc=True)
                yield from _messages(data.read(size), topics)
            elif isinstance(record, Message) and record.channel_id in topics:
                found = loose[topics[record.channel_id]]
                found.append((record.log_time, record.data))
                if len(found) == BLOCK_MESSAGES:
                    yield gathered(topics[record.channel_id], found)
                    found.clear()
            elif isinstance(record, DataEnd):
                break
    for topic, found in loose.items():
        if found:
            yield gathered(topic, found)


def gathered(topic: str, found: Sequence[tuple[int, bytes]]) -> Block:
    """A block of log times and messages."""
    log_times, messages = zip(*found, strict=True)
    return Block(topic, log_times, messages)


def _messages(chunk: bytes, topics: Mapping[int, str]) -> Iterator[Block]:
    found = _walk(np.frombuffer(chunk, np.uint8), Opcode.MESSAGE.value)
    for topic in set(topics.values()):
        channels = [number for number, name in topics.items() if name == topic]
        rows = found[np.isin(found[:, 0], channels)]
        if rows.size:
            _, log_times, starts, ends = rows.T.tolist()
            yield Block(topic, log_times, [chunk[a:b] for a, b in zip(starts, ends, strict=True)])


@njit(cache=True)
def _walk(chunk: np.ndarray, message: int) -> np.ndarray:
    """Channel, log time [ns], start and end of the CDR of each message record (n, 4).

    A record is its opcode (1 byte), its length (8), and that many bytes: for a message channel (2),
    sequence (4), log time (8), publish time (8) and CDR.
    """
    found = np.empty((len(chunk) // (RECORD_HEADER_BYTES + MESSAGE_HEADER_BYTES) + 1, 4), np.int64)
    count, position = 0, 0
    while position < len(chunk):
        start = position + RECORD_HEADER_BYTES
        end = start + _number(chunk, position + 1, 8)
        if end < start or end > len(chunk):
            raise ValueError("a record is longer than its chunk")
        if chunk[position] == message:
            found[count, 0] = _number(chunk, start, 2)
            found[count, 1] = _number(chunk, start + 6, 8)
            found[count, 2] = start + MESSAGE_HEADER_BYTES
            found[count, 3] = end
            count += 1
        position = end
    return found[:count]


@njit(cache=True)
def _number(chunk: np.ndarray, start: int, size: int) -> int:
    """A little endian number."""
    if start + size > len(chunk):
        raise ValueError("a record is cut off")
    value = 0
    for i in range(size - 1, -1, -1):
        value = value * 256 + int(chunk[start + i])
    return value
