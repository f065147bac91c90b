"""Bags written while messages arrive: split files, readable up to the last flush whatever happens.

They are written through the mcap library. The writer of rosbags, which makes bags of simulated
motion, keeps up to 1 MiB in memory (five seconds of this crane), writes one file a bag and no
checksums; here a flush ends the chunk, files follow one another, every chunk has its checksum.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Self

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Nodetype, Qos
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from crane_bags.types import typestore
from crane_model.errors import DataError

METADATA_VERSION = 9
NEVER_NS = 2**63 - 1  # start of a bag without messages

RECORD_BYTES = 31 + 16  # bytes that mcap adds to a message: its record, and its place in the index


@dataclass(frozen=True)
class Definition:
    """Definition of a message type in a bag, so that it can be read without the type."""

    encoding: str  # "ros2msg" or "ros2idl"
    text: str  # with the text of every type in it
    type_hash: str  # RIHS01_...; empty where unknown


@cache
def installed_definition(msgtype: str) -> Definition:
    """The definition of `pkg/msg/Type` as installed on this machine.

    `DataError` if there is none: the package is not installed, or the type is no message.
    """
    store = typestore()
    _complete(store, msgtype)
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    return Definition("ros2msg", text, store.hash_rihs01(msgtype))


def message_class(msgtype: str) -> Any:
    """The Python class of `pkg/msg/Type`; `DataError` if it is not installed."""
    package, _, name = msgtype.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise _absent(msgtype) from None


@cache
def hash_of(msgtype: str, encoding: str, text: str) -> str:
    """Type hash of a definition that came without one; empty where its text does not give it."""
    if encoding != "ros2msg":
        return ""
    try:
        store = Typestore()
        store.register(get_types_from_msg(text, msgtype))
        return store.hash_rihs01(msgtype)
    except Exception:  # the text is whatever stands in somebody's bag
        return ""


def _complete(store: Typestore, msgtype: str) -> None:
    """Add a type, and the types it is made of, from the .msg files of the ament index."""
    if msgtype in store.fielddefs:
        return
    types = get_types_from_msg(_text(msgtype), msgtype)
    for _, description in types[msgtype][1]:
        for name in _names(description):
            _complete(store, name)
    store.register(types)


def _names(description: Any) -> list[str]:
    """Message types in the description of a field: itself, or what it is an array of."""
    kind, inner = description
    if kind == Nodetype.NAME:
        return [inner]
    return [] if kind == Nodetype.BASE else _names(inner[0])


def _text(msgtype: str) -> str:
    package, _, name = msgtype.partition("/msg/")
    try:
        from ament_index_python.packages import get_package_share_path  # absent without ROS

        share = get_package_share_path(package, print_warning=False)
        return (share / "msg" / f"{name}.msg").read_text("utf-8")
    except (ImportError, LookupError, ValueError, OSError):
        raise _absent(msgtype) from None


def _absent(msgtype: str) -> DataError:
    return DataError(
        f"message type {msgtype} is not installed; build its package and source its environment "
        "file"
    )


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as a bag states it; `offered_qos` are the profiles of its publishers."""

    name: str
    msgtype: str
    definition: Definition
    offered_qos: tuple[Qos, ...]
    serialization_format: str = "cdr"


@dataclass
class FileSummary:
    """Messages of one storage file, or of one topic."""

    name: str
    start: int = NEVER_NS  # ns, log time
    end: int = 0  # ns
    count: int = 0

    def add(self, log_time: int) -> None:
        self.start = min(self.start, log_time)
        self.end = max(self.end, log_time)
        self.count += 1


def dump_qos(profiles: Sequence[Qos]) -> str:
    """Profiles as text, as they stand in a storage file."""
    return yaml.safe_dump(dump_qos_v9(list(profiles)), sort_keys=False).strip() if profiles else ""


def metadata(
    files: Sequence[FileSummary],
    topics: Sequence[RecordedTopic],
    counts: Sequence[int],
    remarks: Mapping[str, str],
) -> dict[str, Any]:
    """The content of metadata.yaml; `counts` are the messages of each topic."""
    start = min(file.start for file in files)
    end = max(file.end for file in files)
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": _duration(start, end),
        "starting_time": _time(start),
        "message_count": sum(counts),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.msgtype,
                    "serialization_format": topic.serialization_format,
                    "offered_qos_profiles": dump_qos_v9(list(topic.offered_qos)),
                    "type_description_hash": topic.definition.type_hash,
                },
                "message_count": count,
            }
            for topic, count in zip(topics, counts, strict=True)
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": _time(file.start),
                "duration": _duration(file.start, file.end),
                "message_count": file.count,
            }
            for file in files
        ],
        "custom_data": dict(remarks) or None,
        "ros_distro": "jazzy",
    }


def dump(content: dict[str, Any]) -> str:
    """Text of metadata.yaml."""
    return yaml.safe_dump({"rosbag2_bagfile_information": content}, sort_keys=False)


def _time(nanoseconds: int) -> dict[str, int]:
    return {"nanoseconds_since_epoch": nanoseconds}


def _duration(start: int, end: int) -> dict[str, int]:
    return {"nanoseconds": max(0, end - start)}


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
        with self._space():
            self._files[-1].flush()

    def begin_file(self) -> None:
        with self._space():
            if self._files:
                self._end_file()
            self._files.append(_File(self.path / f"{self.path.name}_{len(self._files)}.mcap"))
            for topic in self.topics:
                self._files[-1].add(topic)

    def close(self) -> None:
        with self._space():
            self._end_file()
            temporary = self.path / "metadata.yaml.tmp"
            summaries = [file.summary for file in self._files]
            content = metadata(summaries, self.topics, self.counts, self.remarks)
            temporary.write_text(dump(content), "utf-8")
            temporary.replace(self.path / "metadata.yaml")

    def _end_file(self) -> None:
        last = self._files[-1]
        file_metadata = metadata([last.summary], self.topics, last.counts, self.remarks)
        last.close(yaml.safe_dump(file_metadata, sort_keys=False))

    @contextmanager
    def _space(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._failed = True
            raise DataError(
                f"{self.path}: cannot write: {error.strerror}; make room, then repair the bag: "
                f"ros2 run crane_nodes recover {self.path} --out {self.path}_recovered"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
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
        self._size += len(data) + RECORD_BYTES
        self.counts[topic] += 1
        self.summary.add(log_time)

    def flush(self) -> None:
        self._writer.flush()

    def close(self, description: str) -> None:
        self.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": description})
        self._writer.finish()
        self._stream.close()
