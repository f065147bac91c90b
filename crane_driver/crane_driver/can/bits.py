"""The bytes of a message and the raw values of its signals."""

from collections.abc import Mapping
from typing import Any

from cantools.database.can import Message, Signal
from cantools.database.utils import create_encode_decode_formats, start_bit


class SignalBits:
    """Packs and unpacks all signals of a message at once, by the formats that cantools compiles.

    `Message.encode` and `Message.decode` do the same signal by signal, for ten times the time, and
    not if signals overlap. Multiplexed messages, whose signals depend on each other, are left to
    them.
    """

    def __init__(self, message: Message):
        self._message = message
        self._multiplexed = message.is_multiplexed()
        layers = [] if self._multiplexed else _layers(message)
        self._formats = [create_encode_decode_formats(one, message.length) for one in layers]
        self.overlap = len(layers) > 1

    def unpack(self, data: bytes) -> Mapping[str, Any]:
        """Raw value of each signal in `data`, which has the length of the message.

        `DecodeError` if a multiplexer has a value that the DBC does not have.
        """
        if self._multiplexed:
            return self._message.decode_simple(data, False, False)
        raw: dict[str, Any] = {}
        for formats in self._formats:
            raw.update(formats.little_endian.unpack(data[::-1]))
            raw.update(formats.big_endian.unpack(data))
        return raw

    def pack(self, raw: Mapping[str, float]) -> bytes:
        """The bytes with a raw value for each signal, none missing, whole numbers as `int`.

        Where signals overlap, bits that either sets are set.
        """
        if self._multiplexed:
            return self._message.encode(raw, False, False, False)
        packed = 0
        for formats in self._formats:
            packed |= int.from_bytes(formats.little_endian.pack(raw)[::-1])
            packed |= int.from_bytes(formats.big_endian.pack(raw))
        return packed.to_bytes(self._message.length)


def _layers(message: Message) -> list[list[Signal]]:
    """Signals that do not overlap; more than one layer only where the message has some that do."""
    layers: list[tuple[list[Signal], set[int]]] = []
    for signal in message.signals:
        bits = _bits(signal)
        layer = next((one for one in layers if not one[1] & bits), None)
        if layer is None:
            layer = [], set()
            layers.append(layer)
        layer[0].append(signal)
        layer[1].update(bits)
    return [signals for signals, _ in layers] or [[]]


def _bits(signal: Signal) -> set[int]:
    """Places of its bits, counted from the highest bit of the first byte."""
    begin = start_bit(signal)
    places = range(begin, begin + signal.length)
    if signal.byte_order == "big_endian":
        return set(places)
    return {place ^ 7 for place in places}
