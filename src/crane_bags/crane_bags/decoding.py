"""From the CDR of many messages of one topic to arrays."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from crane_bags.bulk import FieldLayout, blocks
from crane_bags.clocks import NANOSECONDS
from crane_bags.types import double_fields


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


def same(one: Table, other: Table) -> bool:
    """Whether two tables hold the same, NaN included."""
    return (
        one.names == other.names
        and np.array_equal(one.stamp, other.stamp)
        and np.array_equal(one.present, other.present)
        and one.fields.keys() == other.fields.keys()
        and all(
            np.array_equal(one.fields[field], other.fields[field], equal_nan=True)
            for field in one.fields
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
    return np.array([one.sec * NANOSECONDS + one.nanosec for one in stamps], dtype=np.int64)
