"""Many messages written at once, by laying out the records of mcap as one array.

rosbags packs each message by itself, which at 200 Hz and four topics takes longer than to simulate
the machine whose bag it is. Its storage takes bytes that are laid out already just as well.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from crane_bags.layout import ArrayMessage

CHUNK = 2**20  # bytes, of a chunk, as rosbags has it
RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""What stands in front of the CDR of a message; the length counts from `channel` on."""
COUNTED = RECORD.itemsize - RECORD["opcode"].itemsize - RECORD["length"].itemsize


class MessageSeries(NamedTuple):
    """Messages of one topic: their layout, and its `values`, n rows of each field."""

    connection: Connection
    message: ArrayMessage
    values: Sequence[np.ndarray]

    @property
    def size(self) -> int:
        """Bytes of a record."""
        return RECORD.itemsize + self.message.size

    def records(self, stamps: np.ndarray, rows: slice) -> np.ndarray:
        """(rows, size) uint8: the records of some messages, received at their stamps [ns]."""
        own = stamps[rows]
        head = np.zeros(len(own), RECORD)
        head["opcode"], head["length"] = Opcode.MESSAGE.value, COUNTED + self.message.size
        head["channel"], head["log_time"], head["publish_time"] = self.connection.id, own, own
        data = self.message.serialize_rows(own, *(values[rows] for values in self.values))
        return np.concatenate([head.view(np.uint8).reshape(len(own), -1), data], axis=1)


def append(writer: Writer, stamps: np.ndarray, series: Sequence[MessageSeries]) -> None:
    """Append a message of each of the `series` at each of the increasing stamps (n,) [ns]."""
    storage = writer.storage
    assert isinstance(storage, McapWriter)  # which `BagWriter` opens
    places = np.cumsum([0, *(one.size for one in series)])
    step = max(CHUNK // int(places[-1]), 1)
    for begin in range(0, len(stamps), step):
        rows = slice(begin, begin + step)
        times = stamps[rows].tolist()
        block = np.concatenate([one.records(stamps, rows) for one in series], axis=1)
        chunk = storage.chunk
        starts = chunk.bio.tell() + block.shape[1] * np.arange(len(times))
        chunk.bio.write(block.tobytes())
        for one, place in zip(series, places, strict=False):
            number = one.connection.id
            chunk.msgs[number].extend(zip(times, (starts + place).tolist(), strict=True))
            storage.channel_stats[number] += len(times)
            writer.counts[number] += len(times)
        for first in (chunk, storage):
            first.message_start_time = min(times[0], first.message_start_time)
            first.message_end_time = max(times[-1], first.message_end_time)
        writer.min_timestamp = min(times[0], writer.min_timestamp)
        writer.max_timestamp = max(times[-1], writer.max_timestamp)
        storage.close_chunk()
