"""Fast serialisation of messages of constant layout: only the stamp and the doubles change.

Writing doubles into the bytes of the last message takes a fraction of the time of serialising the
next one from scratch, and at 200 Hz a topic that decides how fast a bag can be made.
"""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from rosbags.typesys.store import Typestore

from crane_bags.clocks import NANOSECONDS
from crane_bags.types import double_fields

STAMP = struct.Struct("<iI")  # builtin_interfaces/Time: sec, nanosec
STAMP_OFFSET = 4  # behind the encapsulation header; std_msgs/Header begins with its stamp


class ArrayMessage:
    """A message of header, `name` and doubles (JointState, CylinderPressures, ...), with constant
    names. Its float64[] fields run parallel to `name`.
    """

    def __init__(self, store: Typestore, msgtype: str, names: Sequence[str]):
        self.fields = double_fields(store, msgtype)
        self._store, self._msgtype, self._names = store, msgtype, list(names)
        if not names:
            raise ValueError(f"{msgtype}: at least one name is needed")
        known = {"header", "name", *self.fields}
        if others := [name for name, _ in store.fielddefs[msgtype][1] if name not in known]:
            raise ValueError(f"{msgtype} is not header, name and doubles; it also has {others}")
        self._buffer, self._places = self._locate()
        self._views = [
            np.frombuffer(self._buffer, "<f8", (place.stop - place.start) // 8, place.start)
            for place in self._places
        ]
        self._verify()

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._buffer)

    def serialize(self, stamp: int, *values: ArrayLike) -> memoryview:
        """CDR of the message: stamp [ns], then the values of each field in the type's order.

        The bytes are the same ones at every call: copy them to keep them.
        """
        STAMP.pack_into(self._buffer, STAMP_OFFSET, *divmod(stamp, NANOSECONDS))
        for view, value in zip(self._views, values, strict=True):
            view[:] = value
        return memoryview(self._buffer)

    def serialize_rows(self, stamps: np.ndarray, *values: np.ndarray) -> np.ndarray:
        """The same of n messages at once, (n, size) uint8: of stamps (n,) [ns] and values (n, k) of
        arrays, (n,) of single doubles.
        """
        rows = np.tile(np.frombuffer(self._buffer, np.uint8), (len(stamps), 1))
        stamp = slice(STAMP_OFFSET, STAMP_OFFSET + STAMP.size)
        rows[:, stamp] = _bytes(np.stack(np.divmod(stamps, NANOSECONDS), axis=1), "<u4")
        for place, value in zip(self._places, values, strict=True):
            rows[:, place] = _bytes(value.reshape(len(rows), -1), "<f8")
        return rows

    def _locate(self) -> tuple[bytearray, list[slice]]:
        """A serialised template and, for each field, which of its bytes are the doubles."""
        marks = self._random_values(seed=0)
        buffer = bytearray(self._reference(0, marks))
        places = []
        for mark in marks:
            if buffer.count(mark.tobytes()) != 1:
                raise ValueError(f"{self._msgtype} with names {self._names}: layout not found")
            start = buffer.find(mark.tobytes())
            places.append(slice(start, start + mark.nbytes))
        return buffer, places

    def _verify(self) -> None:
        """One other message must come out byte for byte as rosbags serialises it."""
        stamp, values = 12 * NANOSECONDS + 34, self._random_values(seed=1)
        if bytes(self.serialize(stamp, *values)) != bytes(self._reference(stamp, values)):
            raise ValueError(f"{self._msgtype}: the layout is not constant")

    def _random_values(self, seed: int) -> list[np.ndarray]:
        random = np.random.default_rng(seed)
        sizes = [len(self._names) if is_array else 1 for is_array in self.fields.values()]
        return [random.uniform(1.0, 2.0, size) for size in sizes]

    def _reference(self, stamp: int, values: list[np.ndarray]) -> memoryview:
        """The message as rosbags serialises it."""
        types = self._store.types
        sec, nanosec = divmod(stamp, NANOSECONDS)
        time = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
        doubles = {
            field: value if is_array else float(value[0])
            for (field, is_array), value in zip(self.fields.items(), values, strict=True)
        }
        message = types[self._msgtype](header=header, name=self._names, **doubles)
        return self._store.serialize_cdr(message, self._msgtype, little_endian=True)


def _bytes(values: np.ndarray, kind: str) -> np.ndarray:
    """(n, bytes) uint8 of values (n, k) as numbers of a kind."""
    return np.ascontiguousarray(values, dtype=kind).view(np.uint8)
