"""The bytes of a message and the raw values of its signals."""

from collections.abc import Mapping
from typing import Any

from cantools.database.can import Message
from cantools.database.utils import create_encode_decode_formats


class SignalBits:
    """Packs and unpacks all signals of a message at once, by the formats that cantools compiles.

    `Message.encode` and `Message.decode` do the same signal by signal, for ten times the time.
    Multiplexed messages, whose signals depend on each other, are left to them.
    """

    def __init__(self, message: Message):
        self._message = message
        self._multiplexed = message.is_multiplexed()
        signals = [] if self._multiplexed else message.signals
        formats = create_encode_decode_formats(signals, message.length)
        self._big, self._little = formats.big_endian, formats.little_endian

    def unpack(self, data: bytes) -> Mapping[str, Any]:
        """Raw value of each signal in `data`, which has the length of the message.

        `DecodeError` if a multiplexer has a value that the DBC does not have.
        """
        if self._multiplexed:
            return self._message.decode_simple(data, False, False)
        raw: dict[str, Any] = self._little.unpack(data[::-1])
        raw.update(self._big.unpack(data))
        return raw

    def pack(self, raw: Mapping[str, float]) -> bytes:
        """The bytes with a raw value for each signal, none missing, whole numbers as `int`."""
        if self._multiplexed:
            return self._message.encode(raw, False, False, False)
        little, big = self._little.pack(raw)[::-1], self._big.pack(raw)
        return (int.from_bytes(little) | int.from_bytes(big)).to_bytes(len(big))
