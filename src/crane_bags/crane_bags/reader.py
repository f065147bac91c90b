"""Reading bags, written by anyone, to plain arrays."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from crane_bags.clocks import MAX_JUMP_NS, NANOSECONDS, SetBack, clock_step, set_back
from crane_bags.decoding import Table, cells, concatenate, decode
from crane_bags.storage import (
    StoredBag,
    announced,
    blocks,
    connections,
    messages,
    open_bag,
    remedy,
)
from crane_bags.types import CAN_FRAMES, DRIVER_STATE, JOINT_STATES, Topic, typestore
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

ROOT = "/"
LETTING_THROUGH = ("STATE_ENABLED", "STATE_DEGRADED")
MAX_DISORDER_NS = NANOSECONDS  # messages may overtake one another, a clock may not step
MIN_MESSAGES_PER_STAMP = 20  # messages with one stamp, from which on stamps are not times


@dataclass(frozen=True)
class TopicData:
    """Content of one topic of a bag, in the order of its stamps.

    log_time: when the recorder received each message, on the clock of the recorder. arrival: place
    of each message in the file; set_back: how time goes back in that order, of the messages that
    were selected. fields: (n, k) of each float64[] field, (n,) of each float64 field, with NaN as
    recorded. notes: repairs, in words.
    """

    bag: Path
    topic: str
    names: tuple[str, ...]
    stamp: np.ndarray  # (n,) int64 [ns], increasing
    stamped_by: Literal["header", "log time"]  # log time where every header stamp is zero
    log_time: np.ndarray  # (n,) int64 [ns]
    arrival: np.ndarray  # (n,) int
    present: np.ndarray  # (n, k) bool: which names a message held
    fields: dict[str, np.ndarray]
    notes: tuple[str, ...] = ()
    set_back: SetBack | None = None

    def select(self, names: Sequence[str]) -> "TopicData":
        """The messages that hold all of `names`, with their columns in this order, each stamp once.

        `DataError` if there is no such message.
        """
        if absent := [name for name in names if name not in self.names]:
            raise DataError(
                f"{self.bag}: topic {self.topic} has no {', '.join(absent)}; it has "
                f"{', '.join(self.names) or 'no names'}; rename the joints of the model or record "
                "the missing ones"
            )
        columns = [self.names.index(name) for name in names]
        rows = np.flatnonzero(self.present[:, columns].all(axis=1))
        if not rows.size:
            raise DataError(
                f"{self.bag}: topic {self.topic} has no message that holds all of "
                f"{', '.join(names)}; publish them in one message"
            )
        arrived = rows[np.argsort(self.arrival[rows])]
        back = set_back(self.stamp[arrived], self.log_time[arrived])
        first = np.diff(self.stamp[rows], prepend=self.stamp[rows[0]] - 1) > 0
        repeated = int(np.count_nonzero(~first))
        rows = rows[first]
        return replace(
            self,
            names=tuple(names),
            stamp=self.stamp[rows],
            log_time=self.log_time[rows],
            arrival=self.arrival[rows],
            present=self.present[cells(rows, columns)],
            fields={
                key: value[cells(rows, columns)] if value.ndim == 2 else value[rows]
                for key, value in self.fields.items()
            },
            notes=(
                *self.notes,
                *_note(back.behind if back else 0, f"{self.topic}: {back}; messages sorted"),
                *_note(repeated, f"{self.topic}: repeated stamps dropped"),
            ),
            set_back=back,
        )


def read_topics(
    path: Path | str,
    required: Collection[Topic],
    optional: Collection[Topic] = (),
    progress: Progress = silent,
) -> Mapping[str, TopicData]:
    """Read topics of header, `name` and doubles as arrays.

    Parameters
    ----------
    path
        Bag: a folder, or one of its files.
    required, optional
        Topics to read; optional topics that the bag does not hold are absent from the result.
    progress
        Told which share of the bag has been read.

    Returns
    -------
    What the bag holds, by the topic's name.

    Raises
    ------
    DataError
        Names bag, topic and remedy: bag absent, not a bag, empty or damaged; topic missing or of
        another type.
    """
    path, store = Path(path), typestore()
    with open_bag(path) as reader:
        wanted = {
            topic.name: topic
            for topic in (*required, *optional)
            if _check(path, reader, topic, store, needed=topic in required)
        }
        if not wanted:
            return {}
        tables, log_times = _read(path, reader, wanted, store, progress)
        empty = [topic.name for topic in optional if topic.name not in wanted]
        notes = {
            name: contradiction(reader, name, *empty)
            + _note(
                max(announced(reader, name)[0] - len(log_times[name]), 0),
                f"{name}: messages that the index of the files states, and that are not there",
            )
            for name in wanted
        }
        return {
            name: in_order(path, name, tables[name], np.array(log_times[name]), notes[name])
            for name in wanted
        }


def contradiction(reader: StoredBag, *topics: str) -> tuple[str, ...]:
    """Notes where metadata.yaml does not fit the files: what it states of topics, and of files."""
    counts = {
        topic: reader.contradictions[topic] for topic in topics if topic in reader.contradictions
    }
    notes = [
        f"{topic}: metadata.yaml states {count.stated} messages, "
        + (
            f"the files hold {count.held}; all of them are used"
            if count.held > count.stated
            else f"the files are whole and hold {count.held}; if more were recorded, copy the bag "
            "again"
        )
        for topic, count in counts.items()
    ]
    if reader.unlisted:
        notes.append(
            f"{', '.join(reader.unlisted)}: not read, because metadata.yaml does not list it; "
            f"{remedy(reader.folder)}"
        )
    return tuple(notes)


def _check(path: Path, reader: StoredBag, topic: Topic, store: Typestore, needed: bool) -> bool:
    """Return whether the bag has `topic`; `DataError` if needed and not, or of another type."""
    count, hashes = announced(reader, topic.name)
    if count == 0:
        if not needed:
            return False
        present = sorted({connection.topic for connection in reader.connections})
        if topic.name in present:
            wrong = reader.contradictions.get(topic.name)
            but = f", and metadata.yaml states {wrong.stated}" if wrong else ""
            raise DataError(
                f"{path}: topic {topic.name} holds no message{but}; check its publisher"
            )
        if frames := {
            connection.topic
            for connection in reader.connections
            if connection.msgtype in CAN_FRAMES
        }:
            raise DataError(
                f"{path}: no topic {topic.name}, but CAN frames on {', '.join(sorted(frames))}; "
                f"decode them first: ros2 run crane_driver decode --log {path} --dbc CAN.dbc "
                "--mapping CAN.yaml --out BAG"
            )
        raise DataError(
            f"{path}: no topic {topic.name}; the bag holds {', '.join(present)}; record the topic, "
            "name yours in a column map (--columns), or name another bag"
        )
    stated = (*connections(reader, topic.name), *reader.connections)
    types = {connection.msgtype for connection in stated if connection.topic == topic.name} - {
        topic.msgtype
    }
    if types:
        raise DataError(
            f"{path}: topic {topic.name} is of type {', '.join(sorted(types))}, expected "
            f"{topic.msgtype}; record the topic that has this type"
        )
    if hashes - {store.hash_rihs01(topic.msgtype)}:
        raise DataError(
            f"{path}: topic {topic.name} was recorded with another definition of {topic.msgtype} "
            "than the installed one; install the version of that time, or record again"
        )
    return True


def _read(
    path: Path,
    reader: Reader,
    wanted: Mapping[str, Topic],
    store: Typestore,
    progress: Progress,
) -> tuple[dict[str, Table], dict[str, list[int]]]:
    """Decoded messages and log times [ns] of each topic, block by block."""
    tables: dict[str, list[Table]] = defaultdict(list)
    log_times: dict[str, list[int]] = defaultdict(list)
    for block in blocks(path, reader, wanted, progress):
        try:
            table = decode(block.messages, wanted[block.topic].msgtype, store)
        except (SerdeError, ValueError) as error:
            raise DataError(f"{path}: topic {block.topic}: {error}; the bag is damaged") from error
        tables[block.topic].append(table)
        log_times[block.topic] += block.log_times
    return {name: concatenate(parts) for name, parts in tables.items()}, log_times


def in_order(
    path: Path, topic: str, table: Table, log_time: np.ndarray, notes: Sequence[str] = ()
) -> TopicData:
    """Rows, in the order of arrival, sorted by header stamp, or by log time where stamps are
    unusable: none is set, or a few stand for all messages.
    """
    distinct = len(np.unique(table.stamp))
    frozen = distinct * MIN_MESSAGES_PER_STAMP < len(table.stamp) and table.stamp.any()
    stamped_by: Literal["header", "log time"] = (
        "header" if table.stamp.any() and not frozen else "log time"
    )
    unstamped = 0
    if stamped_by == "header":
        stamped = table.stamp != 0
        if 0 < table.stamp[1:2].sum() <= MAX_DISORDER_NS:
            stamped[0] = True  # time begins at zero, as in a simulation
        unstamped = int(np.count_nonzero(~stamped))
        table, log_time = table.take(stamped), log_time[stamped]
    stamp = table.stamp if stamped_by == "header" else log_time
    behind = np.maximum.accumulate(stamp) - stamp
    step = clock_step(stamp, log_time)
    # a recorder lets messages overtake one another, but its own clock does not go back
    set_back_too = (np.diff(log_time)[np.diff(stamp) < 0] < 0).any()
    if step is None and behind.max() > (MAX_JUMP_NS if set_back_too else MAX_DISORDER_NS):
        step = int(behind.argmax()), -int(behind.max())
    if step is not None:
        row, change = step
        raise DataError(
            f"{path}: topic {topic}: the clock steps {'back' if change < 0 else 'forward'} by "
            f"{abs(change) / NANOSECONDS:.3f} s at message {row}, stamp {stamp[row]} ns; record "
            "with one clock, or split the bag there"
        )
    order = np.argsort(stamp, kind="stable")
    unusable = f"{distinct} header stamps in all" if frozen else "no header stamp"
    all_notes = (
        *notes,
        *_note(int(stamp is log_time) * len(stamp), f"{topic}: {unusable}, log time used"),
        *_note(unstamped, f"{topic}: messages whose header stamp is zero left out"),
    )
    fields = {key: value[order] for key, value in table.fields.items()}
    return TopicData(
        bag=path,
        topic=topic,
        names=table.names,
        stamp=stamp[order],
        stamped_by=stamped_by,
        log_time=log_time[order],
        arrival=order,
        present=table.present[order],
        fields=fields,
        notes=all_notes,
    )


def _note(count: int, text: str) -> tuple[str, ...]:
    return (f"{text} ({count})",) if count else ()


def namespace_of(path: Path | str) -> str:
    """The namespace whose joint states a bag holds.

    Parameters
    ----------
    path
        Bag: a folder, or one of its files.

    Returns
    -------
    The namespace; the root if it is one of them, or if there is none.

    Raises
    ------
    DataError
        If the bag holds several, none of them the root, and as `open_bag` does.
    """
    with open_bag(Path(path)) as reader:
        found = {
            connection.topic.removesuffix(JOINT_STATES.name) or ROOT
            for connection in reader.connections
            if connection.topic.endswith(JOINT_STATES.name)
            and connection.msgtype == JOINT_STATES.msgtype
            and connection.msgcount
        }
    if ROOT in found or not found:
        return ROOT
    if len(found) > 1:
        namespaces = ", ".join(sorted(found))
        raise DataError(
            f"{path}: holds the joint states of {len(found)} cranes, in the namespaces "
            f"{namespaces}; say which one is meant: --namespace {min(found)}"
        )
    return found.pop()


def let_through(path: Path | str, namespace: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) [ns] of driver/state, in order, and whether commands reached the valves (n,).

    Empty where the bag holds none, or one of another definition, which says less.
    """
    path, store, topic = Path(path), typestore(), DRIVER_STATE.within(namespace)
    found: list[tuple[int, bool]] = []
    with open_bag(path) as reader:
        count, hashes = announced(reader, topic.name)
        if count and not hashes - {store.hash_rihs01(topic.msgtype)}:
            kind = store.types[topic.msgtype]
            states = {getattr(kind, name) for name in LETTING_THROUGH}
            for _, _, data in messages(path, reader, [topic.name]):
                told: Any = store.deserialize_cdr(data, topic.msgtype)
                stamp = told.header.stamp
                found.append((stamp.sec * NANOSECONDS + stamp.nanosec, told.state in states))
    found.sort(key=lambda state: state[0])
    stamps = np.array([stamp for stamp, _ in found], dtype=np.int64)
    return stamps, np.array([through for _, through in found], dtype=bool)
