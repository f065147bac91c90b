"""Writing bags: mcap with raw CDR, type hashes and QoS profiles, as rosbag2 would record them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
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

from crane_bags.bulk_writer import MessageSeries, append
from crane_bags.layout import ArrayMessage
from crane_bags.types import Topic, typestore
from crane_model.errors import DataError

FOREVER = QosTime(9223372036, 854775807)  # how rosbag2 writes an infinite duration


def offered_qos(topic: Topic) -> Qos:
    """What the publishers of the suite offer: reliable; the last message is kept if latched."""
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
    """A new bag in the folder `path`, open until `close` or the end of the `with` block.

    The bag is closed properly also when the block ends in an error: what was recorded until then
    is readable. `DataError` if `path` exists or cannot be made.
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class TopicWriter:
    """One topic of a bag that is being written."""

    def __init__(self, bag: BagWriter, connection: Connection):
        self._bag, self._connection = bag, connection

    @property
    def connection(self) -> Connection:
        """What rosbags calls it."""
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
