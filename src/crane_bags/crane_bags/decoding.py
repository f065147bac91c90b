"""From the CDR of many messages of one topic to arrays.

Messages of one topic differ in their stamps and doubles only, as long as names and lengths stay
the same. So the first is walked through field by field, as CDR lays it out, and all that have the
same bytes wherever a length or a text stands are read as one array. Whatever is unusual, in type or
encoding, is left to rosbags; and rosbags has to read that first message as it was read here.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys.store import Typestore

from crane_bags.clocks import NANOSECONDS
from crane_bags.types import double_fields

LITTLE_ENDIAN = b"\x00\x01"  # encapsulation: plain CDR
ENCAPSULATION_BYTES = 4  # alignment counts from behind them
MAX_PADDING_BYTES = 3  # that a middleware appends
MAX_LAYOUTS = 8  # of one length that are tried, before the rest is left to rosbags

STRING = (Nodetype.BASE, ("string", 0))
DOUBLE = (Nodetype.BASE, ("float64", 0))
HEADER = (Nodetype.NAME, "std_msgs/msg/Header")
STRINGS, DOUBLES = (Nodetype.SEQUENCE, (STRING, 0)), (Nodetype.SEQUENCE, (DOUBLE, 0))


class UnusualError(Exception):
    """A message that is not header, `name` and doubles in little endian CDR, or not whole."""


@dataclass(frozen=True)
class FieldLayout:
    """Offsets of a message's fields, in bytes from its start."""

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
    if len(message) - walk.position > MAX_PADDING_BYTES:
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
        for _ in range(MAX_LAYOUTS):
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
        self.position = ENCAPSULATION_BYTES
        self.stamp: int | None = None
        self.names: list[str] = []
        self.doubles: dict[str, tuple[int, int]] = {}
        self.arrays: list[str] = []
        self.fixed = list(range(len(LITTLE_ENDIAN)))
        self._message = message

    def take(self, field: str, description: FieldDesc) -> None:
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
        offset = self.position + (ENCAPSULATION_BYTES - self.position) % alignment
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


@dataclass(frozen=True)
class Table:
    """Messages of one topic as arrays: one row a message, one column a name (joint, cylinder).

    `present` (n, k) says which names a message held; where it held none the doubles are NaN.
    """

    names: tuple[str, ...]
    stamp: np.ndarray  # (n,) int64, header stamp [ns]; 0 where the type has no header
    present: np.ndarray  # (n, k) bool
    fields: dict[str, np.ndarray]  # (n, k) of each float64[] field, (n,) of each float64 field

    def take(self, rows: np.ndarray | slice) -> "Table":
        """The table of these rows, in this order."""
        fields = {field: value[rows] for field, value in self.fields.items()}
        return Table(self.names, self.stamp[rows], self.present[rows], fields)


def decode(messages: Sequence[bytes], msgtype: str, store: Typestore) -> Table:
    """Decode messages of one type; every decoder of the suite is this function.

    An array may be empty in a message (JointState allows it): NaN. `ValueError` where an array is
    neither empty nor as long as `name`, `SerdeError` where bytes are not of this type.
    """
    kinds = double_fields(store, msgtype)
    left = np.ones(len(messages), dtype=bool)
    order: list[np.ndarray] = []
    tables: list[Table] = []
    for rows, layout, block in blocks(messages, msgtype, store):
        table = _in_bulk(layout, block, kinds)
        if same(
            table.take(slice(1)), decode_by_rosbags(messages[rows[0] : rows[0] + 1], msgtype, store)
        ):
            left[rows] = False
            order.append(rows)
            tables.append(table)
    if left.any():
        rows = np.flatnonzero(left)
        order.append(rows)
        tables.append(decode_by_rosbags([messages[row] for row in rows.tolist()], msgtype, store))
    if len(tables) == 1:
        return tables[0]
    return concatenate(tables).take(np.argsort(np.concatenate(order)))


def decode_by_rosbags(messages: Sequence[bytes], msgtype: str, store: Typestore) -> Table:
    """The same one message after the other: the yardstick of `decode`, and its way out."""
    decoded: list[Any] = [store.deserialize_cdr(message, msgtype) for message in messages]
    rows_of: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for row, message in enumerate(decoded):
        rows_of[tuple(getattr(message, "name", ()))].append(row)
    names = tuple(dict.fromkeys(name for layout in rows_of for name in layout))
    columns_of = {layout: [names.index(name) for name in layout] for layout in rows_of}

    present = np.zeros((len(decoded), len(names)), dtype=bool)
    for layout, rows in rows_of.items():
        present[cells(rows, columns_of[layout])] = True
    fields = {}
    for field, is_array in double_fields(store, msgtype).items():
        values = [getattr(message, field) for message in decoded]
        if not is_array:
            fields[field] = np.array(values, dtype=float)
            continue
        fields[field] = np.full(present.shape, np.nan)
        for layout, rows in rows_of.items():
            filled = [row for row in rows if len(values[row])]
            if wrong := [row for row in filled if len(values[row]) != len(layout)]:
                raise ValueError(f"{field} has {len(values[wrong[0]])} values for {list(layout)}")
            if filled:
                block = np.array([values[row] for row in filled])
                fields[field][cells(filled, columns_of[layout])] = block
    return Table(names, header_stamps(decoded), present, fields)


def same(first: Table, second: Table) -> bool:
    """Return whether two tables hold the same, NaN included."""
    return (
        first.names == second.names
        and np.array_equal(first.stamp, second.stamp)
        and np.array_equal(first.present, second.present)
        and first.fields.keys() == second.fields.keys()
        and all(
            np.array_equal(first.fields[field], second.fields[field], equal_nan=True)
            for field in first.fields
        )
    )


def cells(rows: Sequence[int] | np.ndarray, columns: Sequence[int]) -> tuple[np.ndarray, ...]:
    """Index of the cells in which `rows` and `columns` of a table cross."""
    return np.asarray(rows, dtype=int)[:, np.newaxis], np.asarray(columns, dtype=int)


def concatenate(tables: Sequence[Table]) -> Table:
    """One table of all rows; its names are those of all tables in order of appearance."""
    names = tuple(dict.fromkeys(name for table in tables for name in table.names))
    order = [[names.index(name) for name in table.names] for table in tables]
    rows = [len(table.stamp) for table in tables]

    def stack(parts: list[np.ndarray], filler: float | bool) -> np.ndarray:
        if parts[0].ndim == 1:
            return np.concatenate(parts)
        widened = [np.full((n, len(names)), filler) for n in rows]
        for wide, columns, part in zip(widened, order, parts, strict=True):
            wide[:, columns] = part
        return np.concatenate(widened)

    return Table(
        names,
        np.concatenate([table.stamp for table in tables]),
        stack([table.present for table in tables], False),
        {key: stack([table.fields[key] for table in tables], np.nan) for key in tables[0].fields},
    )


def _in_bulk(layout: FieldLayout, block: np.ndarray, kinds: Mapping[str, bool]) -> Table:
    """Messages (n, length) of one layout; a name that stands twice keeps its last value."""
    names = tuple(dict.fromkeys(layout.names))
    columns = [names.index(name) for name in layout.names]
    fields = {}
    for field, is_array in kinds.items():
        values = layout.values(block, field)
        if not is_array:
            fields[field] = values[:, 0]
            continue
        fields[field] = np.full((len(block), len(names)), np.nan)
        if values.size:
            fields[field][:, columns] = values
    present = np.ones((len(block), len(names)), dtype=bool)
    return Table(names, layout.stamps(block), present, fields)


def header_stamps(messages: Sequence[Any]) -> np.ndarray:
    """(n,) int64 header stamps [ns] of decoded messages of one type; 0 without a header."""
    if not hasattr(messages[0], "header"):
        return np.zeros(len(messages), dtype=np.int64)
    stamps = [message.header.stamp for message in messages]
    return np.array([stamp.sec * NANOSECONDS + stamp.nanosec for stamp in stamps], dtype=np.int64)
