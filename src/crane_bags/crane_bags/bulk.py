"""Messages that share one layout, decoded all at once.

Messages of one topic differ in their stamps and doubles only, as long as names and lengths stay the
same. So one of them is walked through field by field, as CDR lays it out, and all that have the
same bytes wherever a length or a text stands are read as one array. Whatever is unusual, in type or
encoding, is left to rosbags; and rosbags has to read that one message as it was read here.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys.store import Typestore

from crane_bags.clocks import NANOSECONDS

LITTLE_ENDIAN = b"\x00\x01"  # encapsulation: plain CDR
ENCAPSULATION = 4  # bytes; alignment counts from behind them
PADDING = 3  # bytes, at most, that a middleware appends
LAYOUTS = 8  # of one length that are tried, before the rest is left to rosbags

STRING = (Nodetype.BASE, ("string", 0))
DOUBLE = (Nodetype.BASE, ("float64", 0))
HEADER = (Nodetype.NAME, "std_msgs/msg/Header")
STRINGS, DOUBLES = (Nodetype.SEQUENCE, (STRING, 0)), (Nodetype.SEQUENCE, (DOUBLE, 0))


class UnusualError(Exception):
    """A message that is not header, `name` and doubles in little endian CDR, or not whole."""


@dataclass(frozen=True)
class FieldLayout:
    """Where the fields of a message stand; offsets in bytes from its start."""

    names: tuple[str, ...]
    stamp: int | None  # offset; None without a header
    doubles: dict[str, tuple[int, int]]  # field: offset and number of values
    fixed: np.ndarray  # (f,) offsets of the bytes that all messages of this layout share

    def stamps(self, block: np.ndarray) -> np.ndarray:
        """(n,) int64 header stamps [ns] of messages (n, length) uint8; 0 without a header."""
        if self.stamp is None:
            return np.zeros(len(block), dtype=np.int64)
        bytes_ = np.ascontiguousarray(block[:, self.stamp : self.stamp + 8])
        seconds, nanoseconds = bytes_.view("<i4")[:, 0], bytes_.view("<u4")[:, 1]
        return seconds.astype(np.int64) * NANOSECONDS + nanoseconds

    def values(self, block: np.ndarray, field: str) -> np.ndarray:
        """(n, count) of a field of messages (n, length) uint8."""
        offset, count = self.doubles[field]
        return np.ascontiguousarray(block[:, offset : offset + 8 * count]).view("<f8")


def find_layout(message: bytes, msgtype: str, store: Typestore) -> FieldLayout:
    """The layout of one message; `UnusualError` where it is not of the kind that this can read."""
    if message[:2] != LITTLE_ENDIAN:
        raise UnusualError("not little endian CDR")
    walk = _Walk(message)
    for field, description in store.fielddefs[msgtype][1]:
        walk.take(field, description)
    if len(message) - walk.position > PADDING:
        raise UnusualError("bytes left over")
    counts = {walk.doubles[field][1] for field in walk.arrays}
    if counts - {0, len(walk.names)}:
        raise UnusualError("arrays that are not parallel to name")
    return FieldLayout(tuple(walk.names), walk.stamp, walk.doubles, np.array(walk.fixed))


def blocks(
    messages: Sequence[bytes], msgtype: str, store: Typestore
) -> Iterator[tuple[np.ndarray, FieldLayout, np.ndarray]]:
    """Row numbers (n,), their layout and their bytes (n, length), of all that share a layout.

    Rows that are in no block are left to rosbags.
    """
    lengths = np.fromiter(map(len, messages), dtype=int, count=len(messages))
    for length in np.unique(lengths):
        rows = np.flatnonzero(lengths == length)
        parts = messages if len(rows) == len(messages) else [messages[row] for row in rows.tolist()]
        block = np.frombuffer(b"".join(parts), np.uint8).reshape(len(rows), length)
        for _ in range(LAYOUTS):
            if not len(rows):
                break
            try:
                layout = find_layout(messages[int(rows[0])], msgtype, store)
            except UnusualError:
                break
            same = (block[:, layout.fixed] == block[0, layout.fixed]).all(axis=1)
            yield rows[same], layout, block[same]
            rows, block = rows[~same], block[~same]


class _Walk:
    """Through the fields of one message, from the first to the last."""

    def __init__(self, message: bytes):
        self.position = ENCAPSULATION
        self.stamp: int | None = None
        self.names: list[str] = []
        self.doubles: dict[str, tuple[int, int]] = {}
        self.arrays: list[str] = []
        self.fixed = list(range(len(LITTLE_ENDIAN)))
        self._message = message

    def take(self, field: str, description: FieldDesc) -> None:
        """Go past one field."""
        if description == HEADER:
            self.stamp = self._bytes(8, alignment=4)
            self._text()
        elif description == STRINGS and field == "name":
            self.names = [self._text() for _ in range(self._count())]
        elif description == DOUBLE:
            self.doubles[field] = (self._bytes(8, alignment=8), 1)
        elif description == DOUBLES:
            count = self._count()
            offset = self._bytes(8 * count, alignment=8) if count else self.position
            self.doubles[field] = (offset, count)
            self.arrays.append(field)
        else:
            raise UnusualError(f"{field} is of another type")

    def _bytes(self, size: int, alignment: int) -> int:
        """Offset of the next `size` bytes; those between are padding and may hold anything."""
        offset = self.position + (ENCAPSULATION - self.position) % alignment
        self.position = offset + size
        if self.position > len(self._message):
            raise UnusualError("cut off")
        return offset

    def _fixed(self, size: int, alignment: int) -> int:
        offset = self._bytes(size, alignment)
        self.fixed += range(offset, offset + size)
        return offset

    def _count(self) -> int:
        (count,) = struct.unpack_from("<I", self._message, self._fixed(4, alignment=4))
        return int(count)

    def _text(self) -> str:
        size = self._count()
        offset = self._fixed(size, alignment=1)
        try:
            return self._message[offset : offset + size].rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise UnusualError("a name that is not UTF-8") from None
