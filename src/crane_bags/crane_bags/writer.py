"""Writing bags: mcap with raw CDR, type hashes and QoS profiles, as rosbag2 would record them.

Messages of constant layout, in which only the stamp and the doubles change, are written into the
bytes of the last one, and many of them at once as one array: packing each message by itself, as
rosbags does, takes longer at 200 Hz and four topics than to simulate the machine whose bag it is.
"""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import ArrayLike
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore

from crane_bags.clocks import NANOSECONDS
from crane_bags.decoding import find_layout
from crane_bags.types import Topic, double_fields, typestore
from crane_model.errors import DataError

STAMP = struct.Struct("<iI")  # builtin_interfaces/Time: sec, nanosec
STAMP_OFFSET = 4  # behind the encapsulation header; std_msgs/Header begins with its stamp


class ArrayMessage:
    """A message of header, `name` and doubles (JointState, CylinderPressures, ...), with constant
    names. Its float64[] fields run parallel to `name`.
    """

    def __init__(self, store: Typestore, msgtype: str, names: Sequence[str]):
        self.fields = double_fields(store, msgtype)
        if not names:
            raise ValueError(f"{msgtype}: at least one name is needed")
        known = {"header", "name", *self.fields}
        if unknown := [name for name, _ in store.fielddefs[msgtype][1] if name not in known]:
            raise ValueError(f"{msgtype} is not header, name and doubles; it also has {unknown}")
        zeros = {key: np.zeros(len(names)) if array else 0.0 for key, array in self.fields.items()}
        types = store.types
        time = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
        message = types[msgtype](header=header, name=list(names), **zeros)
        self._buffer = bytearray(store.serialize_cdr(message, msgtype, little_endian=True))
        doubles = find_layout(bytes(self._buffer), msgtype, store).doubles
        self._places = [slice(start, start + 8 * count) for start, count in doubles.values()]
        self._views = [
            np.frombuffer(self._buffer, "<f8", count, start) for start, count in doubles.values()
        ]

    @property
    def size(self) -> int:
        return len(self._buffer)

    def serialize(self, stamp: int, *values: ArrayLike) -> memoryview:
        """CDR of the message: stamp [ns], then the values of each field in the type's order.

        The bytes are the same ones at every call: copy them to keep them.
        """
        STAMP.pack_into(self._buffer, STAMP_OFFSET, *divmod(stamp, NANOSECONDS))
        for view, value in zip(self._views, values, strict=True):
            view[:] = value
        return memoryview(self._buffer)

    def serialize_rows(self, stamps: np.ndarray, *values: np.ndarray) -> np.ndarray:
        """n messages at once, (n, size) uint8, of stamps (n,) [ns] and values (n, k) or (n,)."""
        rows = np.tile(np.frombuffer(self._buffer, np.uint8), (len(stamps), 1))
        stamp = slice(STAMP_OFFSET, STAMP_OFFSET + STAMP.size)
        rows[:, stamp] = _bytes(np.stack(np.divmod(stamps, NANOSECONDS), axis=1), "<u4")
        for place, value in zip(self._places, values, strict=True):
            rows[:, place] = _bytes(value.reshape(len(rows), -1), "<f8")
        return rows


def _bytes(values: np.ndarray, kind: str) -> np.ndarray:
    """(n, bytes) uint8 of values (n, k) as numbers of a kind."""
    return np.ascontiguousarray(values, dtype=kind).view(np.uint8)


CHUNK_BYTES = 2**20  # of a chunk, as rosbags has it
RECORD_DTYPE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""Record in front of the CDR of a message; the length counts from `channel` on."""
COUNTED = RECORD_DTYPE.itemsize - RECORD_DTYPE["opcode"].itemsize - RECORD_DTYPE["length"].itemsize


class MessageSeries(NamedTuple):
    """Messages of one topic: their layout, and its `values`, n rows of each field."""

    connection: Connection
    message: ArrayMessage
    values: Sequence[np.ndarray]

    @property
    def size(self) -> int:
        return RECORD_DTYPE.itemsize + self.message.size

    def records(self, stamps: np.ndarray, rows: slice) -> np.ndarray:
        """(rows, size) uint8: the records of some messages, received at their stamps [ns]."""
        received = stamps[rows]
        head = np.zeros(len(received), RECORD_DTYPE)
        head["opcode"], head["length"] = Opcode.MESSAGE.value, COUNTED + self.message.size
        head["channel"], head["log_time"], head["publish_time"] = (
            self.connection.id,
            received,
            received,
        )
        data = self.message.serialize_rows(received, *(values[rows] for values in self.values))
        return np.concatenate([head.view(np.uint8).reshape(len(received), -1), data], axis=1)


def append(writer: Writer, stamps: np.ndarray, series: Sequence[MessageSeries]) -> None:
    """Append a message of each of the `series` at each of the increasing stamps (n,) [ns]."""
    storage = writer.storage
    assert isinstance(storage, McapWriter)  # which `BagWriter` opens
    places = np.cumsum([0, *(topic.size for topic in series)])
    step = max(CHUNK_BYTES // int(places[-1]), 1)
    for begin in range(0, len(stamps), step):
        rows = slice(begin, begin + step)
        times = stamps[rows].tolist()
        block = np.concatenate([topic.records(stamps, rows) for topic in series], axis=1)
        chunk = storage.chunk
        starts = chunk.bio.tell() + block.shape[1] * np.arange(len(times))
        chunk.bio.write(block.tobytes())
        for topic, place in zip(series, places, strict=False):
            number = topic.connection.id
            chunk.msgs[number].extend(zip(times, (starts + place).tolist(), strict=True))
            storage.channel_stats[number] += len(times)
            writer.counts[number] += len(times)
        for first in (chunk, storage):
            first.message_start_time = min(times[0], first.message_start_time)
            first.message_end_time = max(times[-1], first.message_end_time)
        writer.min_timestamp = min(times[0], writer.min_timestamp)
        writer.max_timestamp = max(times[-1], writer.max_timestamp)
        storage.close_chunk()


FOREVER = QosTime(9223372036, 854775807)  # how rosbag2 writes an infinite duration


def offered_qos(topic: Topic) -> Qos:
    """Quality of service of the suite's publishers: reliable; latched topics keep one message."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if topic.latched else 10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE,
        deadline=FOREVER,
        lifespan=FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=FOREVER,
        avoid_ros_namespace_conventions=False,
    )


class BagWriter:
    """A new bag, open until `close` or the end of the `with` block.

    The bag is closed properly also if the block ends in an error: what was recorded until then is
    readable.

    Parameters
    ----------
    path
        Folder to make.

    Raises
    ------
    DataError
        If `path` exists or cannot be made.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.store = typestore()
        try:
            self._writer = Writer(
                self.path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
            )
            self._writer.open()
        except (WriterError, OSError) as error:
            raise DataError(
                f"{self.path}: cannot make a bag here: {error} Name a folder that does not exist."
            ) from None

    def add(self, topic: Topic) -> "TopicWriter":
        """Announce a topic; its messages are then written through the channel."""
        connection = self._writer.add_connection(
            topic.name,
            topic.msgtype,
            typestore=self.store,
            offered_qos_profiles=[offered_qos(topic)],
        )
        return TopicWriter(self, connection)

    def add_arrays(self, topic: Topic, names: Sequence[str]) -> "ArrayChannel":
        """Announce a topic of header, constant `names` and doubles: the fast way to write it."""
        return ArrayChannel(self.add(topic), ArrayMessage(self.store, topic.msgtype, names))

    def write(self, connection: Connection, log_time: int, data: bytes | memoryview) -> None:
        """Append the CDR of one message, received at `log_time` [ns]."""
        self._writer.write(connection, log_time, data)

    def write_together(
        self, stamps: np.ndarray, series: Mapping["ArrayChannel", Sequence[np.ndarray]]
    ) -> None:
        """Append a message of each channel at each of the increasing stamps (n,) [ns], at which it
        was received too; of a channel the values of each field, (n, k) or (n,).
        """
        parts = [channel.series(values) for channel, values in series.items()]
        append(self._writer, stamps, parts)

    def close(self) -> None:
        """Write index and metadata; the bag is unreadable before that."""
        self._writer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class TopicWriter:
    """One topic of a bag that is being written."""

    def __init__(self, bag: BagWriter, connection: Connection):
        self._bag, self._connection = bag, connection

    @property
    def connection(self) -> Connection:
        return self._connection

    def write(self, log_time: int, message: object) -> None:
        """Append a message object of the bag's `store`, received at `log_time` [ns]."""
        self.write_raw(log_time, self._bag.store.serialize_cdr(message, self._connection.msgtype))

    def write_raw(self, log_time: int, data: bytes | memoryview) -> None:
        """Append the CDR of a message (a raw subscription), received at `log_time` [ns]."""
        self._bag.write(self._connection, log_time, data)


class ArrayChannel:
    """One topic of messages of constant names."""

    def __init__(self, channel: TopicWriter, message: ArrayMessage):
        self._channel, self._message = channel, message

    def write(self, log_time: int, stamp: int, *values: ArrayLike) -> None:
        """Append a message: `log_time` [ns], header `stamp` [ns], then the values in the order of
        the message type, e.g. position, velocity, effort (k,) of a JointState with k names.
        """
        self._channel.write_raw(log_time, self._message.serialize(stamp, *values))

    def series(self, values: Sequence[np.ndarray]) -> MessageSeries:
        """Messages of these values, n rows of each field."""
        return MessageSeries(self._channel.connection, self._message, values)
