"""Single numbers out of the messages of any topic, of any type."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from crane_bags.decoding import Table, header_stamps
from crane_bags.reader import TopicData, contradiction, in_order
from crane_bags.storage import blocks, connections, open_bag
from crane_bags.types import typestore
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

NAMES = "name"
"""Field whose texts name the places of the arrays beside it, as in sensor_msgs/JointState."""
IDL_RULE = "=" * 80 + "\n"


class AbsentError(ValueError):
    """A message that is about other names, or leaves an array empty: others may hold the number."""


@dataclass(frozen=True)
class Place:
    """Place of a number in a message.

    Parameters
    ----------
    field
        Field of the message; dots lead into fields and places of arrays.
    index
        Place in an array, counted from 0 or named by `name` of the message; None for a single
        value.
    """

    field: str
    index: int | str | None = None

    def __str__(self) -> str:
        return self.field if self.index is None else f"{self.field}[{self.index}]"

    def number(self, message: Any) -> float:
        """The number of a message of rosbags or rclpy.

        `ValueError` says what the message has instead, `AbsentError` if another one may have it.
        """
        value = message
        for part in self.field.split("."):
            value = _element(value, int(part)) if part.isdigit() else _field(value, part)
        if self.index is None:
            if np.ndim(value):
                raise ValueError(f"{self} holds {len(value)} values; give the index of one, from 0")
            return _float(value)
        if not np.ndim(value):
            raise ValueError(f"{self.field} holds a single value; take out the index")
        if not len(value):
            raise AbsentError(f"{self.field} is empty")
        if isinstance(self.index, int):
            return _float(_element(value, self.index))
        names = list(_field(message, NAMES))
        if self.index not in names:
            raise AbsentError(f"{self}: its names are {', '.join(names) or 'none'}")
        return _float(_element(value, names.index(self.index)))

    def number_if_any(self, message: Any) -> float:
        """The same, NaN where another message may have it."""
        try:
            return self.number(message)
        except AbsentError:
            return math.nan


def _field(value: Any, name: str) -> Any:
    try:
        return getattr(value, name)
    except AttributeError:
        fields = getattr(value, "__dataclass_fields__", None) or value.get_fields_and_field_types()
        present = [field for field in fields if not field.startswith("_")]
        raise ValueError(f"no field '{name}'; there are {', '.join(present)}") from None


def _float(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"no number, but {type(value).__name__}; name a field of it") from None


def _element(values: Any, place: int) -> Any:
    if place >= len(values):
        raise ValueError(f"no place {place} in an array of {len(values)}, counted from 0")
    return values[place]


def read_fields(
    path: Path | str,
    wanted: Mapping[str, Collection[Place]],
    types: Mapping[str, str],
    progress: Progress = silent,
) -> Mapping[str, TopicData]:
    """Read numbers of any topics of any types as arrays; each stamp stays once.

    Message types are those that the bag defines, else those of ROS 2 Jazzy and of the suite.

    Parameters
    ----------
    path
        Bag: a folder, or one of its files.
    wanted
        Places in the messages of each topic, by the topic's name.
    types
        Message types that topics must have.
    progress
        Told which share of the bag has been read.

    Returns
    -------
    By the topic's name; `fields` holds (n,) of each place, keyed by its text.

    Raises
    ------
    DataError
        Names bag, topic, what there is instead, and the remedy.
    """
    path = Path(path)
    gathered = {topic: _Gathered(tuple(places)) for topic, places in wanted.items()}
    with open_bag(path) as reader:
        known = {topic: _type(path, reader, topic, types.get(topic)) for topic in wanted}
        for block in blocks(path, reader, wanted, progress):
            msgtype, store = known[block.topic]
            try:
                decoded = [store.deserialize_cdr(message, msgtype) for message in block.messages]
                gathered[block.topic].add(decoded, block.log_times)
            except (SerdeError, ValueError) as error:
                raise DataError(
                    f"{path}: topic {block.topic}, {msgtype}: {error}; correct the column map"
                ) from error
            except KeyError as error:
                raise DataError(
                    f"{path}: topic {block.topic}: the definition of {msgtype} in the bag lacks "
                    f"{error}; record it again with the package of that type installed"
                ) from error
        return {
            topic: gathering.data(path, topic, contradiction(reader, topic))
            for topic, gathering in gathered.items()
        }


def read_messages(
    path: Path | str, msgtypes: Collection[str], progress: Progress = silent
) -> Iterator[tuple[str, int, Any]]:
    """All messages of some types, whatever their topics.

    Parameters
    ----------
    path
        Bag: a folder, or one of its files.
    msgtypes
        Types of the messages, for example can_msgs/msg/Frame.
    progress
        Told which share of the bag has been read.

    Yields
    ------
    Topic, log time [ns] and message, those of each topic in the order of the files, as they
    arrived.

    Raises
    ------
    DataError
        If the bag cannot be read, or holds no topic of these types.
    """
    path = Path(path)
    with open_bag(path) as reader:
        stated = {connection.topic: connection.msgtype for connection in reader.connections}
        topics = [topic for topic, msgtype in stated.items() if msgtype in msgtypes]
        if not topics:
            there = ", ".join(f"{topic} ({msgtype})" for topic, msgtype in sorted(stated.items()))
            raise DataError(
                f"{path}: no topic of type {' or '.join(msgtypes)}; the bag holds {there}; record "
                "such a topic, or name another bag"
            )
        stores = {topic: _store(path, connections(reader, topic)) for topic in topics}
        for topic, log_times, found in blocks(path, reader, topics, progress):
            for log_time, data in zip(log_times, found, strict=True):
                try:
                    message = stores[topic].deserialize_cdr(data, stated[topic])
                except (SerdeError, ValueError) as error:
                    raise DataError(
                        f"{path}: topic {topic}: {error}; the bag is damaged"
                    ) from error
                yield topic, log_time, message


class _Gathered:
    """Numbers of the messages of one topic."""

    def __init__(self, places: Sequence[Place]):
        self._places = places
        self._numbers: list[list[float]] = []
        self._stamps: list[np.ndarray] = []
        self._log_times: list[int] = []
        self._names: set[str] = set()

    def add(self, messages: Sequence[Any], log_times: Sequence[int]) -> None:
        self._numbers += [[place.number_if_any(m) for place in self._places] for m in messages]
        self._stamps.append(header_stamps(messages))
        self._log_times += log_times
        self._names.update(getattr(messages[0], NAMES, ()))

    def data(self, path: Path, topic: str, notes: Sequence[str]) -> TopicData:
        numbers = np.array(self._numbers, dtype=float)
        fields = {str(place): numbers[:, i] for i, place in enumerate(self._places)}
        for place, values in fields.items():
            if np.isnan(values).all():
                names = f"; its names are {', '.join(sorted(self._names))}" if self._names else ""
                raise DataError(f"{path}: topic {topic}: {place} never holds a number{names}")
        nobody = np.ones((len(numbers), 0), dtype=bool)
        table = Table((), np.concatenate(self._stamps), nobody, fields)
        return in_order(path, topic, table, np.array(self._log_times), notes).select(())


def _type(path: Path, reader: Reader, topic: str, expected: str | None) -> tuple[str, Typestore]:
    """The message type of a topic, and a store that knows it."""
    sources = connections(reader, topic)
    if (
        not any(
            connection.msgcount for connection in reader.connections if connection.topic == topic
        )
        or not sources
    ):
        there = sorted(
            {f"{connection.topic} ({connection.msgtype})" for connection in reader.connections}
        )
        raise DataError(
            f"{path}: no message of topic {topic}; the bag holds {', '.join(there)}; correct the "
            "column map, or record the topic"
        )
    msgtypes = {source.msgtype for source in sources}
    if msgtypes - {expected or sources[0].msgtype}:
        raise DataError(
            f"{path}: topic {topic} is of type {', '.join(sorted(msgtypes))}, expected "
            f"{expected or 'a single one'}; correct the column map"
        )
    return sources[0].msgtype, _store(path, sources)


def _store(path: Path, sources: Sequence[Connection]) -> Typestore:
    msgtype = sources[0].msgtype
    defined = [source for source in sources if source.msgdef.format != MessageDefinitionFormat.NONE]
    if not defined:
        store = typestore()
        if msgtype not in store.fielddefs:
            raise DataError(
                f"{path}: the bag does not define {msgtype}, and neither does ROS 2 Jazzy; record "
                "it as mcap, or with ros2 bag of Jazzy, which keep definitions"
            )
        return store
    text = defined[0].msgdef.data
    try:
        if defined[0].msgdef.format == MessageDefinitionFormat.MSG:
            types = get_types_from_msg(text, msgtype)
        else:
            parts = text.split(IDL_RULE)[1:] if text.startswith(IDL_RULE) else ["\n" + text]
            types = {}
            for part in parts:  # the first line names the file
                types |= get_types_from_idl(part.split("\n", 1)[1])
        store = Typestore()
        store.register(types)
    except TypesysError as error:
        raise DataError(
            f"{path}: the definition of {msgtype} in the bag is not readable: {error}"
        ) from error
    return store
