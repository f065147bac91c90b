"""metadata.yaml of a bag folder, version 9, as rosbag2 and rosbags read it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9

from crane_nodes.recording.definitions import Definition

VERSION = 9
NEVER = 2**63 - 1  # start of a bag without messages


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
    """What one storage file holds."""

    name: str
    start: int = NEVER  # ns, log time
    end: int = 0  # ns
    count: int = 0

    def add(self, log_time: int) -> None:
        """Count a message received at `log_time` [ns]."""
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
        "version": VERSION,
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
