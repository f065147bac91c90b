"""DBC files: loaded with errors that say what is wrong, and searched by identifier."""

import logging
import math
import re
from collections import Counter
from collections.abc import Collection
from pathlib import Path

import cantools.database
from cantools.database import Database, Error, UnsupportedDatabaseFormatError
from cantools.database.can import Message, Signal
from cantools.database.utils import start_bit
from cantools.j1939 import frame_id_unpack, pgn_from_frame_id

from crane_driver.can.bus_log import encoding_of
from crane_driver.can.frame import show_id
from crane_driver.can.layout import LARGEST_MEASUREMENT, Channel, Code, Codes
from crane_model.errors import ConfigurationError

J1939 = "j1939"
FRAME_FORMAT = "VFrameFormat"  # attribute of a message
ANY_ADDRESS = frozenset(
    {0xFE, 0xFF}
)  # addresses of no single device: a DBC states them for any one
FIRST_BROADCAST_FORMAT = 240  # PDU format from which on a frame has no destination address

STRING = re.compile(r'"[^"]*"')
SIGNAL = re.compile(r"^\s*SG_\s+\w+[^:;\n]*:", re.MULTILINE)
INDEPENDENT = re.compile(
    r"^BO_ 3221225472 .*(?:\n\s+SG_ .*)*", re.MULTILINE
)  # signals of no message

# It announces every message that overwrites another; load_dbc refuses those.
logging.getLogger("cantools.database.can.database").setLevel(logging.ERROR)

LARGEST_VALUE = 1.7e308  # stands for no limit: what is beyond is infinite or not a number
SLACK_STEPS = 0.49  # steps, less than what rounds to the next one


class Dbc:
    """The messages of a DBC file."""

    def __init__(self, path: Path, database: Database):
        self.path = path
        self.messages: dict[str, Message] = {message.name: message for message in database.messages}
        self._found: dict[tuple[int, bool], Message | None] = {
            (message.frame_id, message.is_extended_frame): message for message in database.messages
        }
        self._of_group: dict[int, list[Message]] = {}
        for message in database.messages:
            if message.is_extended_frame and may_be_j1939(message):
                self._of_group.setdefault(pgn_from_frame_id(message.frame_id), []).append(message)

    def find(self, identifier: int, extended: bool) -> Message | None:
        """The message with this identifier; else, of J1939, the only one with its group number.

        Priority and source address then do not matter: J1939 data bases often name a placeholder as
        the source, and do not say that they are of J1939 (see `by_group_alone`).
        """
        key = (identifier, extended)
        if key not in self._found:
            group = self._of_group.get(pgn_from_frame_id(identifier), []) if extended else []
            alone = len(group) == 1 and addressed(group[0], identifier)
            self._found[key] = group[0] if alone else None
        return self._found[key]

    def any_source(self, message: Message) -> bool:
        """Return whether a reading takes the message from any source address.

        It does if the DBC names a placeholder, and no other message of the group. A real address is
        that of one device: in its place, another one of the same make must not be believed.
        """
        group = self._of_group.get(pgn_from_frame_id(message.frame_id), [])
        return (
            group == [message] and frame_id_unpack(message.frame_id).source_address in ANY_ADDRESS
        )


def addressed(message: Message, identifier: int) -> bool:
    """Return whether a frame of the group goes to the address of the DBC, or to any."""
    stated, sent = frame_id_unpack(message.frame_id), frame_id_unpack(identifier)
    if stated.pdu_format >= FIRST_BROADCAST_FORMAT or stated.pdu_specific in ANY_ADDRESS:
        return True
    return bool(stated.pdu_specific == sent.pdu_specific)


def by_group_alone(message: Message, shown: str) -> bool:
    """Return whether only the group number says that frames of the id `shown` are this message."""
    stated = show_id(message.frame_id, message.is_extended_frame)
    return message.protocol != J1939 and shown != stated


def may_be_j1939(message: Message) -> bool:
    """Return whether the DBC says so, or says nothing of the format of the frames."""
    specifics = message.dbc
    stated = specifics is not None and FRAME_FORMAT in specifics.attributes
    return message.protocol == J1939 or (message.is_extended_frame and not stated)


def load_dbc(path: Path | str) -> Dbc:
    """Load a DBC file; `ConfigurationError` if it is absent, not a DBC or contradicts itself."""
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    text = _text(content).lstrip("\ufeff")  # a converted file may have a second mark
    try:
        # not strict, for flags may overlap the byte that they are in: checked below
        database = cantools.database.load_string(text, database_format="dbc", strict=False)
    except UnsupportedDatabaseFormatError as error:
        reason = "".join(
            character if character.isprintable() else "?" for character in str(error.e_dbc or error)
        )
        raise ConfigurationError(f"{path}: not a valid DBC file: {reason}") from None
    if not isinstance(database, Database) or not database.messages:
        raise ConfigurationError(f"{path}: no messages (BO_) in this file; name a DBC file")
    _check_whole(path, text, database)
    _check_fit(path, database)
    _check_unique(path, database)
    return Dbc(path, database)


def _text(content: bytes) -> str:
    """Text of a DBC file: by its byte order mark, else of the encoding that fits it."""
    if marked := encoding_of(content):
        return content.decode(marked, "replace")
    for encoding in ("utf-8", "gb2312"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return content.decode("cp1252", "replace")  # what the format's inventor writes


def _check_fit(path: Path, database: Database) -> None:
    """Signals within their messages; those of a multiplexed message must not overlap, either."""
    for message in database.messages:
        try:
            if message.is_multiplexed():
                message.refresh(strict=True)
            for signal in message.signals:
                if start_bit(signal) + signal.length > 8 * message.length:
                    raise Error(f"The signal {signal.name} does not fit in message {message.name}.")
                if signal.scale == 0:
                    raise Error(
                        f"The signal {signal.name} of message {message.name} has the factor 0: all "
                        "its values would be one."
                    )
            names = Counter(signal.name for signal in message.signals)
            if twice := [name for name, count in names.items() if count > 1]:
                raise Error(f"The message {message.name} has two signals {twice[0]}.")
        except Error as error:
            raise ConfigurationError(f"{path}: not a valid DBC file: {error}") from None


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


CODE_LABELS = {
    Code.NOT_AVAILABLE: re.compile(
        r"s\W?n\W?a\W?|n\W?a\W?|(signal ?)?not ?avail(able)?|invalid( .*)?|ung\w+ltig", re.I
    ),
    Code.ERROR: re.compile(r"(.* )?(error|fault|failure|fehler)", re.I),
    Code.RESERVED: re.compile(r"reserved.*|reserviert", re.I),
}


def codes_of(message: Message, signal: Signal) -> Codes:
    """Codes of a signal, by J1939 and by its value table.

    The greatest values are codes of J1939 if the message may be of J1939, and the DBC neither
    states a range, other than all that the bits hold, nor gives such a value another meaning. A
    value table says so only of what is measured: the states of others are numbers.
    """
    labels = {int(raw): _code_of_label(str(label)) for raw, label in (signal.choices or {}).items()}
    named = {raw: code for raw, code in labels.items() if code}
    others = labels.keys() - named.keys()
    measured = signal.unit or is_scaled(signal)
    return Codes(_code_bits(message, signal, others), named if measured else {})


def _code_of_label(label: str) -> Code | None:
    words = label.replace("_", " ").strip()
    return next((code for code, names in CODE_LABELS.items() if names.fullmatch(words)), None)


def _code_bits(message: Message, signal: Signal, named: Collection[int]) -> int:
    """Bits of a signal whose greatest values are codes of J1939; 0 if they are measurements.

    `named`: raw values with a meaning that is not one of a code.
    """
    if not may_be_j1939(message) or signal.is_float or signal.is_signed:
        return 0
    if signal.length not in LARGEST_MEASUREMENT:
        return 0
    greatest = 2**signal.length - 1
    if signal.minimum is not None and signal.maximum is not None:
        limits = (signal.minimum, signal.maximum)
        if max((limit - signal.offset) / signal.scale for limit in limits) < greatest - SLACK_STEPS:
            return 0
    codes = Codes(signal.length)
    return 0 if any(codes.of(raw) for raw in named) else signal.length


def to_channel(
    name: str, signal: Signal, factor: float, shift: float, fault: str | None, codes: Codes
) -> Channel:
    """Channel of a signal whose physical value times `factor` plus `shift` is the SI value."""
    gain, offset = signal.scale * factor, signal.offset * factor + shift
    least, greatest = raw_limits(signal)
    if codes.length:
        greatest = LARGEST_MEASUREMENT[codes.length]
    ends = [gain * raw + offset for raw in (least, greatest)]
    # Limits are given in decimals, which the steps of the signal need not meet.
    slack = 0.0 if signal.is_float else SLACK_STEPS * abs(gain)
    low, high = max(min(ends) - slack, -LARGEST_VALUE), min(max(ends) + slack, LARGEST_VALUE)
    return Channel(name, signal.name, gain, offset, low, high, fault, signal.is_float, codes)


def raw_limits(signal: Signal) -> tuple[float, float]:
    """Least and greatest raw value: those that the DBC states, else those that the bits hold."""
    if signal.is_float:
        low, high = -math.inf, math.inf
    elif signal.is_signed:
        low, high = -(2 ** (signal.length - 1)), 2 ** (signal.length - 1) - 1
    else:
        low, high = 0, 2**signal.length - 1
    stated = [
        (limit - signal.offset) / signal.scale
        for limit in (signal.minimum, signal.maximum)
        if limit is not None
    ]
    if len(stated) == 2:
        low, high = max(low, min(stated)), min(high, max(stated))
    return low, high


def is_scaled(signal: Signal) -> bool:
    """Return whether raw and physical value differ."""
    return signal.scale != 1 or signal.offset != 0


def fills_byte(signal: Signal) -> bool:
    """Return whether the raw value is one whole byte of the frame."""
    first_bit = 0 if signal.byte_order == "little_endian" else 7
    return signal.length == 8 and signal.start % 8 == first_bit and not is_scaled(signal)
