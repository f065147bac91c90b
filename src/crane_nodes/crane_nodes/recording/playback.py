"""What of a bag is played, and when."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader

from crane_bags.storage import announced, messages
from crane_bags.types import VALVE_COMMAND
from crane_model.errors import DataError
from crane_nodes.recording.definitions import installed_definition, message_class
from crane_nodes.recording.qos import Service, offer

COMMAND = VALVE_COMMAND.name.rpartition("/")[2]
CLOCK = "clock"  # of the namespace


@dataclass(frozen=True)
class PlayedTopic:
    """A topic of a bag and what stands in the place of its publishers."""

    recorded: str
    name: str  # onto which it is played
    msgtype: str
    service: Service


@dataclass(frozen=True)
class Selection:
    """Topics that are played, and for each one left out the reason."""

    played: tuple[PlayedTopic, ...]
    left_out: Mapping[str, str]


def select(
    path: Path,
    reader: Reader,
    topics: Collection[str],
    allow_valve_command: bool,
    resolve: Callable[[str], str],
) -> Selection:
    """What can be played of the `topics` of a bag (none: of all).

    `resolve` gives the name onto which a recorded topic is played; none is played onto a valve
    command, in whatever namespace, unless that is allowed. `DataError` if a topic is not in the
    bag or nothing is left to play.
    """
    recorded = sorted({one.topic for one in reader.connections})
    if absent := [name for name in topics if name not in recorded]:
        raise DataError(
            f"{path}: no topic {', '.join(absent)}; the bag holds {', '.join(recorded)}"
        )
    played, left_out = [], {}
    for name in sorted(topics) or recorded:
        found = [one for one in reader.connections if one.topic == name]
        onto, msgtype = resolve(name), found[0].msgtype
        if reason := _obstacle(reader, found, onto, allow_valve_command):
            left_out[name] = reason
        else:
            extensions = [cast(ConnectionExtRosbag2, one.ext) for one in found]
            profiles = [qos for one in extensions for qos in one.offered_qos_profiles]
            played.append(PlayedTopic(name, onto, msgtype, offer(profiles)))
    if not played:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise DataError(f"{path}: nothing to play ({reasons})")
    return Selection(tuple(played), left_out)


def _obstacle(reader: Reader, found: Sequence[Connection], onto: str, allow: bool) -> str:
    """Why a topic is not played; empty if it is."""
    name, msgtype = found[0].topic, found[0].msgtype
    if onto.rpartition("/")[2] == COMMAND and not allow:
        return "would move the crane; --allow-valve-command plays it"
    if onto.rpartition("/")[2] == CLOCK:
        return "the time of the bag is played there"
    if len({one.msgtype for one in found}) > 1:
        return "has messages of more than one type"
    try:
        message_class(msgtype)
        definition = installed_definition(msgtype)
    except DataError as error:
        return str(error)
    if announced(reader, name)[1] - {definition.type_hash}:
        return f"recorded with another definition of {msgtype} than the installed one"
    return ""


@dataclass(frozen=True)
class Due:
    """A message and the time at which it is played."""

    time: int  # ns, of the bag
    topic: str  # as recorded
    data: bytes


def schedule(path: Path, reader: Reader, selection: Selection) -> Iterator[Due]:
    """The messages in the order of the bag."""
    for connection, log_time, data in messages(
        path, reader, [topic.recorded for topic in selection.played]
    ):
        yield Due(log_time, connection.topic, bytes(data))


class PlaybackPace:
    """Where the time of the bag stands on the steady clock; both in ns.

    `rate` seconds of the bag pass in one second.
    """

    def __init__(self, bag_start: int, steady_start: int, rate: float):
        self._bag_start, self._steady_start, self._rate = bag_start, steady_start, rate

    def steady(self, bag_time: int) -> int:
        """When a message of this time is due."""
        return self._steady_start + round((bag_time - self._bag_start) / self._rate)

    def bag(self, steady_time: int) -> int:
        """The time of the bag at this moment."""
        return self._bag_start + round((steady_time - self._steady_start) * self._rate)
