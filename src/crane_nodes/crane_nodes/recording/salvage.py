"""What can be read of mcap files that were never closed: every whole record up to the damage."""

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import get_chunk_data_stream
from rosbags.rosbag2.metadata import parse_qos

from crane_bags.storage import MCAP_MAGIC
from crane_model.errors import DataError
from crane_nodes.recording.definitions import Definition, hash_of
from crane_nodes.recording.metadata import RecordedTopic

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
            cut = f"; its last {len(rest)} bytes are no whole record" if rest else ""
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
        """Messages of the content of a chunk."""
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
