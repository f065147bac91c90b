"""Bags written while messages arrive: split files, readable up to the last flush whatever happens.

They are written through the mcap library. The writer of rosbags, which makes bags of simulated
motion, keeps up to 1 MiB in memory (five seconds of this crane), writes one file a bag and no
checksums; here a flush ends the chunk, files follow one another, every chunk has its checksum.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import yaml
from mcap.writer import CompressionType, Writer

from crane_model.errors import DataError
from crane_nodes.recording.metadata import (
    FileSummary,
    RecordedTopic,
    dump,
    dump_qos,
    metadata,
)

RECORD = 31 + 16  # bytes that mcap adds to a message: its record, and its place in the index


@dataclass(frozen=True)
class Split:
    """When a new file is begun: at this size [bytes] or after this duration [s]."""

    size: float = math.inf
    duration: float = math.inf


class RecordedBag:
    """A new bag in the folder `path`: NAME_0.mcap, NAME_1.mcap, ..., and metadata.yaml at `close`.

    Until `close` the folder is no bag to any reader, so that a part is never taken for the whole;
    what was flushed until then can be recovered. `remarks` go into the metadata. `DataError` if
    `path` exists or cannot be made, or when its disk refuses to take more.
    """

    def __init__(self, path: Path | str, split: Split | None = None):
        self.path = Path(path)
        self.split = split or Split()
        self.topics: list[RecordedTopic] = []
        self.counts: list[int] = []
        self.remarks: dict[str, str] = {}
        self._files: list[_File] = []
        self._failed = False
        try:
            self.path.mkdir(parents=True)
        except OSError as error:
            raise DataError(
                f"{self.path}: cannot make a bag here: {error.strerror}; name a folder that does "
                "not exist"
            ) from None
        self.begin_file()

    def add(self, topic: RecordedTopic) -> int:
        """Announce a topic; the number returned stands for it in `write`."""
        self.topics.append(topic)
        self.counts.append(0)
        self._files[-1].add(topic)
        return len(self.topics) - 1

    def write(
        self, topic: int, log_time: int, data: bytes, publish_time: int = 0, sequence: int = 0
    ) -> None:
        """Append the serialised message that was received at `log_time` [ns].

        `publish_time` [ns] (0: as log time) and `sequence` are the publisher's, where known.
        """
        if self._files[-1].full(self.split, log_time):
            self.begin_file()
        with self._space():
            self._files[-1].write(topic, log_time, data, publish_time or log_time, sequence)
        self.counts[topic] += 1

    def flush(self) -> None:
        """Hand everything to the operating system: it survives the end of this process."""
        with self._space():
            self._files[-1].flush()

    def begin_file(self) -> None:
        """End the current file, if any, and go on in the next one."""
        with self._space():
            if self._files:
                self._end_file()
            self._files.append(_File(self.path / f"{self.path.name}_{len(self._files)}.mcap"))
            for topic in self.topics:
                self._files[-1].add(topic)

    def close(self) -> None:
        """Write the index of the last file and the metadata."""
        with self._space():
            self._end_file()
            temporary = self.path / "metadata.yaml.tmp"
            summaries = [file.summary for file in self._files]
            content = metadata(summaries, self.topics, self.counts, self.remarks)
            temporary.write_text(dump(content), "utf-8")
            temporary.replace(self.path / "metadata.yaml")

    def _end_file(self) -> None:
        last = self._files[-1]
        own = metadata([last.summary], self.topics, last.counts, self.remarks)
        last.close(yaml.safe_dump(own, sort_keys=False))

    @contextmanager
    def _space(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._failed = True
            raise DataError(
                f"{self.path}: cannot write: {error.strerror}; make room, then mend the bag: "
                f"ros2 run crane_nodes recover {self.path} --out {self.path}_recovered"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self._failed:  # else its end is missing, and an index would hide that
            self.close()


class _File:
    """One mcap file, which holds every topic of the bag and can be read by itself."""

    def __init__(self, path: Path):
        self.summary = FileSummary(path.name)
        self.counts: list[int] = []
        self._size = 0
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: list[int] = []
        self._stream = path.open("xb")
        # Uncompressed, as rosbag2 does by default: recording leaves the processor to the others.
        self._writer = Writer(self._stream, compression=CompressionType.NONE)
        self._writer.start("ros2", "crane_driver")
        self.flush()

    def add(self, topic: RecordedTopic) -> None:
        definition = topic.definition
        key = (topic.msgtype, definition.text)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                topic.msgtype, definition.encoding, definition.text.encode()
            )
        described = {
            "offered_qos_profiles": dump_qos(topic.offered_qos),
            "topic_type_hash": definition.type_hash,
        }
        self._channels.append(
            self._writer.register_channel(
                topic.name, topic.serialization_format, self._schemas[key], described
            )
        )
        self.counts.append(0)

    def full(self, split: Split, log_time: int) -> bool:
        return self.summary.count > 0 and (
            self._size >= split.size or log_time - self.summary.start >= split.duration * 1e9
        )

    def write(
        self, topic: int, log_time: int, data: bytes, publish_time: int, sequence: int
    ) -> None:
        self._writer.add_message(
            self._channels[topic], log_time, data, publish_time, sequence & 0xFFFFFFFF
        )
        self._size += len(data) + RECORD
        self.counts[topic] += 1
        self.summary.add(log_time)

    def flush(self) -> None:
        self._writer.flush()

    def close(self, description: str) -> None:
        self.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": description})
        self._writer.finish()
        self._stream.close()
