"""DBC files: loaded with errors that say what is wrong, and searched by identifier."""

import logging
import re
from pathlib import Path

import cantools.database
from cantools.database import Database, UnsupportedDatabaseFormatError
from cantools.database.can import Message
from cantools.j1939 import pgn_from_frame_id

from crane_driver.can.frame import show_id
from crane_model.errors import ConfigurationError

J1939 = "j1939"
FRAME_FORMAT = "VFrameFormat"  # attribute of a message

STRING = re.compile(r'"[^"]*"')
SIGNAL = re.compile(r"^\s*SG_\s+\w+[^:;\n]*:", re.MULTILINE)
INDEPENDENT = re.compile(
    r"^BO_ 3221225472 .*(?:\n\s+SG_ .*)*", re.MULTILINE
)  # signals of no message

# It announces every message that overwrites another; load_dbc refuses those.
logging.getLogger("cantools.database.can.database").setLevel(logging.ERROR)


class Dbc:
    """The messages of a DBC file."""

    def __init__(self, path: Path, database: Database):
        self.path = path
        self.messages: dict[str, Message] = {one.name: one for one in database.messages}
        self._found: dict[tuple[int, bool], Message | None] = {
            (one.frame_id, one.is_extended_frame): one for one in database.messages
        }
        self._of_group: dict[int, list[Message]] = {}
        for one in database.messages:
            if one.is_extended_frame and _may_be_j1939(one):
                self._of_group.setdefault(pgn_from_frame_id(one.frame_id), []).append(one)

    def find(self, identifier: int, extended: bool) -> Message | None:
        """The message with this identifier; else, of J1939, the only one with its group number.

        Priority, source and destination address then do not matter: J1939 data bases often name a
        placeholder as the source, and do not say that they are of J1939 (see `by_group_alone`).
        """
        key = (identifier, extended)
        if key not in self._found:
            group = self._of_group.get(pgn_from_frame_id(identifier), []) if extended else []
            self._found[key] = group[0] if len(group) == 1 else None
        return self._found[key]


def by_group_alone(message: Message, shown: str) -> bool:
    """Whether only the group number says that frames of the id `shown` are this message."""
    own = show_id(message.frame_id, message.is_extended_frame)
    return message.protocol != J1939 and shown != own


def _may_be_j1939(message: Message) -> bool:
    """Whether the DBC says so, or says nothing of the format of the frames."""
    specifics = message.dbc
    stated = specifics is not None and FRAME_FORMAT in specifics.attributes
    return message.protocol == J1939 or not stated


def load_dbc(path: Path | str) -> Dbc:
    """Load a DBC file; `ConfigurationError` if it is absent, not a DBC or contradicts itself."""
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")  # what the format's inventor writes
    try:
        database = cantools.database.load_string(text, database_format="dbc")
    except UnsupportedDatabaseFormatError as error:
        reason = str(error.e_dbc or error)
        raise ConfigurationError(f"{path}: not a valid DBC file: {reason}") from None
    if not isinstance(database, Database) or not database.messages:
        raise ConfigurationError(f"{path}: no messages (BO_) in this file; name a DBC file")
    _check_whole(path, text, database)
    _check_unique(path, database)
    return Dbc(path, database)


def _check_whole(path: Path, text: str, database: Database) -> None:
    """A file that ends in the middle of a line loads, too, without what is cut off."""
    loaded = sum(len(message.signals) for message in database.messages)
    declared = len(SIGNAL.findall(INDEPENDENT.sub("", STRING.sub('""', text))))
    if loaded < declared:
        raise ConfigurationError(
            f"{path}: not a valid DBC file: of {declared} signals (SG_) only {loaded} are whole; "
            "is the file cut off?"
        )


def _check_unique(path: Path, database: Database) -> None:
    names: set[str] = set()
    owners: dict[str, str] = {}
    for message in database.messages:
        if message.name in names:
            raise ConfigurationError(f"{path}: two messages have the name {message.name}")
        names.add(message.name)
        shown = show_id(message.frame_id, message.is_extended_frame)
        if shown in owners:
            raise ConfigurationError(
                f"{path}: messages {owners[shown]} and {message.name} have the same id {shown}"
            )
        owners[shown] = message.name
