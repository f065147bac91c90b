"""What a sqlite3 file of a bag holds together with its write-ahead log, closed or not."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

from mcap.records import Message
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from crane_bags.storage import unfinished
from crane_model.errors import DataError
from crane_nodes.recording.definitions import Definition, installed_definition
from crane_nodes.recording.metadata import RecordedTopic


class DatabaseSalvage:
    """Messages of one .db3 file in order of log time, as `Salvage` gives those of an mcap file.

    SQLite itself brings file and log together, in a copy: the original is not touched. `DataError`
    if the file is no readable bag.
    """

    def __init__(self, path: Path):
        self.path = path
        self._logs = unfinished(path)
        self.size = sum(one.stat().st_size for one in (path, *self._logs))
        self.notes = [f"{path.name} was not closed: {log.name} read too" for log in self._logs]

    def __iter__(self) -> Iterator[tuple[RecordedTopic, Message]]:
        with TemporaryDirectory() as folder:
            for one in (self.path, *self._logs):
                shutil.copy(one, folder)
            copy = Path(folder) / self.path.name
            try:
                with closing(sqlite3.connect(copy)) as database:
                    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                reader = Sqlite3Reader(copy)
                reader.open()
                with closing(reader):
                    yield from _messages(reader)
            except (sqlite3.Error, ReaderError) as error:
                raise DataError(f"{self.path}: nothing can be recovered: {error}") from error


def _messages(reader: Sqlite3Reader) -> Iterator[tuple[RecordedTopic, Message]]:
    topics = {one.id: _topic(one) for one in reader.connections}
    for number, (source, log_time, data) in enumerate(reader.messages(reader.connections)):
        yield topics[source.id], Message(source.id, log_time, data, log_time, number)


def _topic(source: Connection) -> RecordedTopic:
    ext = cast(ConnectionExtRosbag2, source.ext)
    return RecordedTopic(
        source.topic,
        source.msgtype,
        _definition(source),
        tuple(ext.offered_qos_profiles),
        ext.serialization_format,
    )


def _definition(source: Connection) -> Definition:
    """As the file states it; files of older versions hold none, then as installed, if it is."""
    if source.msgdef.data:
        encoding = "ros2idl" if source.msgdef.format is MessageDefinitionFormat.IDL else "ros2msg"
        return Definition(encoding, source.msgdef.data, source.digest)
    try:
        return installed_definition(source.msgtype)
    except DataError:
        return Definition("ros2msg", "", "")
