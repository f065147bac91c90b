"""`ros2 run crane_nodes recover`: a readable bag out of one that was never closed."""

import re
import shutil
import sqlite3
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, cast

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import get_chunk_data_stream
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from crane_bags.storage import MCAP_MAGIC, STORAGE_SUFFIXES, unfinished
from crane_model.cli import command_line, run
from crane_model.errors import DataError
from crane_model.progress_bar import progress_bar
from crane_nodes.recording.bag import (
    Definition,
    FileSummary,
    RecordedBag,
    RecordedTopic,
    hash_of,
    installed_definition,
)
from crane_nodes.recording.statistics import table

HEAD = struct.Struct("<BQ")  # of a record: kind, and length of what follows

Salvaged = tuple[RecordedTopic, Message]


class Salvage:
    """Messages of one mcap file, closed or not, in the order in which they were written.

    `position` [bytes] says how far it was read, `notes` what of it could not be. The StreamReader
    of the mcap library takes what is left of a record at the end of a file for a whole one; this
    reader does not. `DataError` if the file is no mcap file.
    """

    def __init__(self, path: Path):
        self.path = path
        self.size = path.stat().st_size
        self.position = 0
        self.notes: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, RecordedTopic] = {}

    def __iter__(self) -> Iterator[Salvaged]:
        with self.path.open("rb") as stream:
            if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                raise DataError(f"{self.path}: not an mcap file; nothing can be recovered from it")
            for kind, content in _records(stream, self.size):
                self.position = stream.tell()
                if kind == Opcode.DATA_END:
                    return
                yield from self._read(kind, content)
            self.position, rest = stream.tell(), stream.read()
            cut = f"; its last {len(rest)} bytes are not a whole record" if rest else ""
            self.notes.append(f"{self.path.name} was not closed{cut}")
            yield from self._cut_chunk(rest)

    def _read(self, kind: int, content: bytes) -> Iterator[Salvaged]:
        begin = self.position - len(content)
        try:
            if kind == Opcode.CHUNK:
                chunk, size = get_chunk_data_stream(Chunk.read(_data(content)), validate_crc=True)
                yield from self._messages(chunk.read(size))
            else:
                yield from self._record(kind, content)
        except Exception as error:  # whatever the parser stumbles over
            self.notes.append(f"{self.path.name}: record at byte {begin} left out: {error}")

    def _messages(self, data: bytes) -> Iterator[Salvaged]:
        for kind, content in _records(BytesIO(data), len(data)):
            yield from self._record(kind, content)

    def _record(self, kind: int, content: bytes) -> Iterator[Salvaged]:
        if kind == Opcode.MESSAGE:
            message = Message.read(_data(content), len(content))
            yield self._topics[message.channel_id], message
        elif kind == Opcode.SCHEMA:
            schema = Schema.read(_data(content))
            self._schemas[schema.id] = schema
        elif kind == Opcode.CHANNEL:
            channel = Channel.read(_data(content))
            self._topics[channel.id] = _topic(channel, self._schemas[channel.schema_id])

    def _cut_chunk(self, rest: bytes) -> Iterator[Salvaged]:
        """Whole messages of an uncompressed chunk that was not written to its end."""
        if rest[:1] != bytes([Opcode.CHUNK]):
            return
        try:
            chunk = Chunk.read(_data(rest[HEAD.size :]))
            if not chunk.compression:
                yield from self._messages(chunk.data)
        except Exception as error:
            self.notes.append(f"{self.path.name}: its last chunk is not readable: {error}")


def _records(stream: BinaryIO, end: int) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each whole record; leaves the stream where the first other one begins."""
    while (begin := stream.tell()) < end:
        head = stream.read(HEAD.size)
        kind, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        if kind == 0 or length > end - stream.tell():  # no record is of kind 0
            stream.seek(begin)
            return
        yield kind, stream.read(length)


def _data(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _topic(channel: Channel, schema: Schema) -> RecordedTopic:
    text = schema.data.decode()
    stated = channel.metadata.get("topic_type_hash")
    return RecordedTopic(
        channel.topic,
        schema.name,
        Definition(schema.encoding, text, stated or hash_of(schema.name, schema.encoding, text)),
        tuple(parse_qos(channel.metadata.get("offered_qos_profiles", ""))),
        channel.message_encoding,
    )


class DatabaseSalvage:
    """Messages of one .db3 file in order of log time, as `Salvage` gives those of an mcap file.

    SQLite itself brings file and log together, in a copy: the original is not touched. `DataError`
    if the file is no readable bag.
    """

    def __init__(self, path: Path):
        self.path = path
        self._logs = unfinished(path)
        self.size = sum(file.stat().st_size for file in (path, *self._logs))
        self.notes = [f"{path.name} was not closed: {log.name} read too" for log in self._logs]

    def __iter__(self) -> Iterator[tuple[RecordedTopic, Message]]:
        with TemporaryDirectory() as folder:
            for file in (self.path, *self._logs):
                shutil.copy(file, folder)
            copy = Path(folder) / self.path.name
            try:
                with closing(sqlite3.connect(copy)) as database:
                    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                reader = Sqlite3Reader(copy)
                reader.open()
                with closing(reader):
                    yield from _messages(reader)
            except (sqlite3.Error, ReaderError) as error:
                raise DataError(f"{self.path}: nothing can be recovered: {error}") from error


def _messages(reader: Sqlite3Reader) -> Iterator[tuple[RecordedTopic, Message]]:
    topics = {connection.id: _sqlite_topic(connection) for connection in reader.connections}
    for number, (source, log_time, data) in enumerate(reader.messages(reader.connections)):
        yield topics[source.id], Message(source.id, log_time, data, log_time, number)


def _sqlite_topic(source: Connection) -> RecordedTopic:
    ext = cast(ConnectionExtRosbag2, source.ext)
    return RecordedTopic(
        source.topic,
        source.msgtype,
        _definition(source),
        tuple(ext.offered_qos_profiles),
        ext.serialization_format,
    )


def _definition(source: Connection) -> Definition:
    """As the file states it; files of older versions hold none, then as installed, if it is."""
    if source.msgdef.data:
        encoding = "ros2idl" if source.msgdef.format is MessageDefinitionFormat.IDL else "ros2msg"
        return Definition(encoding, source.msgdef.data, source.digest)
    try:
        return installed_definition(source.msgtype)
    except DataError:
        return Definition("ros2msg", "", "")


def main(argv: Sequence[str] | None = None) -> int:
    """Write what can be read of a damaged bag as a new one."""
    parser = command_line(description="Make a readable copy of a bag that was not closed.")
    parser.add_argument("bag", type=Path, metavar="BAG", help="bag: a folder, or one of its files")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="NEW", help="new folder of the bag"
    )
    options = parser.parse_args(argv)
    return run(lambda: print(recover(options.bag, options.out)))


def recover(damaged: Path, out: Path) -> str:
    """Write the messages of `damaged` as the new bag `out`; what was saved, as a report.

    `DataError` if there is nothing to save or `out` cannot be made.
    """
    if damaged.resolve() in out.resolve().parents:
        raise DataError(f"{out}: would change the damaged bag; name a folder outside of it")
    salvages = [
        DatabaseSalvage(path) if path.suffix == ".db3" else Salvage(path)
        for path in _files(damaged)
    ]
    numbers: dict[RecordedTopic, int] = {}
    saved: dict[RecordedTopic, FileSummary] = {}
    with ExitStack() as stack:
        bar = stack.enter_context(
            progress_bar(f"recovering {damaged.name}", sum(salvage.size for salvage in salvages))
        )
        bag: RecordedBag | None = None
        for salvage in salvages:
            for count, (topic, message) in enumerate(salvage):
                if bag is None:  # nothing is made before there is something to save
                    bag = stack.enter_context(RecordedBag(out))
                elif count == 0:
                    bag.begin_file()
                if topic not in saved:
                    numbers[topic], saved[topic] = bag.add(topic), FileSummary(topic.name)
                saved[topic].add(message.log_time)
                bag.write(
                    numbers[topic],
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
            bar.update(salvage.size)
    notes = [note for salvage in salvages for note in salvage.notes]
    if not saved:
        raise DataError(f"{damaged}: holds no whole message ({'; '.join(notes)}); record again")
    return _report(out, saved, notes)


def _files(damaged: Path) -> list[Path]:
    """The storage files of a bag in the order of their numbers."""
    if damaged.is_file():
        return [damaged]
    for suffix in STORAGE_SUFFIXES:
        if files := list(damaged.glob(f"*{suffix}")):
            return sorted(files, key=lambda path: [*map(int, re.findall(r"\d+", path.stem))][-1:])
    raise DataError(
        f"{damaged}: no {' or '.join(STORAGE_SUFFIXES)} file here; name the folder of a bag, or "
        "its file"
    )


def _report(out: Path, saved: dict[RecordedTopic, FileSummary], notes: list[str]) -> str:
    begin = min(topic_saved.start for topic_saved in saved.values())
    rows = [
        (
            topic.name,
            topic.msgtype,
            str(topic_saved.count),
            f"{(topic_saved.start - begin) * 1e-9:.3f}",
            f"{(topic_saved.end - begin) * 1e-9:.3f}",
        )
        for topic, topic_saved in saved.items()
    ]
    total = sum(topic_saved.count for topic_saved in saved.values())
    lines = [
        table(("topic", "type", "messages", "from [s]", "to [s]"), rows),
        *notes,
        f"{out}: {total} messages saved",
    ]
    return "\n".join(lines)
