"""From values to frames to be sent, with counters and checksums."""

from collections.abc import Mapping, Sequence
from typing import Any

from cantools.database.can import Message, Signal
from cantools.database.utils import create_encode_decode_formats, start_bit

from crane_driver.can.frame import Frame
from crane_driver.can.layout import Channel, MessageLayout
from crane_model.errors import RangeError

# The bytes of a message and the raw values of its signals.


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

        If signals overlap, a bit is set if either signal sets it.
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


# Counters and checksums of frames, as pure functions.
#
# CRC-8 SAE J1850: AUTOSAR, Specification of CRC Routines. End-to-end profile 1 with both bytes of
# the data id: AUTOSAR, E2E Protocol Specification; it starts the same polynomial at 0, without
# inversion.

POLYNOMIAL = 0x1D  # x^8 + x^4 + x^3 + x^2 + 1


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


TABLE = bytes(_remainder(byte) for byte in range(256))


def crc8(data: bytes, start: int = 0) -> int:
    """Remainder of `data` by the polynomial of SAE J1850, from `start`, neither inverted."""
    table, crc = TABLE, start
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def sae_j1850(data: bytes) -> int:
    """CRC-8 SAE J1850: from 0xFF, inverted."""
    return crc8(data, 0xFF) ^ 0xFF


def autosar_e2e_1(data: bytes, data_id: int) -> int:
    """CRC of E2E profile 1 over the data id (16 bit, low byte first) and `data`."""
    return crc8(data, TABLE[TABLE[data_id & 0xFF] ^ (data_id >> 8)])


def frame_crc(data: bytes, position: int, data_id: int | None) -> int:
    """CRC of a frame over all its bytes but the one at `position`, which holds the CRC.

    By E2E profile 1 where there is a data id, else by SAE J1850 alone.
    """
    covered = data[:position] + data[position + 1 :]
    return sae_j1850(covered) if data_id is None else autosar_e2e_1(covered, data_id)


def lost_frames(previous: int, current: int, count: int) -> int:
    """Frames lost between two counters that run from 0 to count - 1: 0 is right, -1 a repetition.

    A loss of `count` frames or more looks like a smaller one.
    """
    return (current - previous) % count - 1


# From values to frames to be sent.


class Encoder:
    """Encodes messages of a layout, and counts their counters on."""

    def __init__(self, messages: Sequence[MessageLayout]):
        self._counters = {one.name: one.protection.counter_first for one in messages}
        self._bits = {one.name: SignalBits(one.message) for one in messages}

    def encode(self, layout: MessageLayout, raw: Mapping[str, float]) -> Frame:
        """Frame with these raw values (none missing, whole numbers as `int`) and the next counter
        and checksum.
        """
        message, protection = layout.message, layout.protection
        values = dict(raw)
        if protection.counter:
            values[protection.counter] = self._counters[layout.name]
            self._count(layout)
        if protection.crc:
            values[protection.crc] = 0
        data = self._bits[layout.name].pack(values)
        if protection.crc:
            crc = frame_crc(data, protection.crc_byte, protection.data_id)
            position = protection.crc_byte
            data = data[:position] + bytes((crc,)) + data[position + 1 :]
        return Frame(message.frame_id, data, message.is_extended_frame)

    def _count(self, layout: MessageLayout) -> None:
        protection = layout.protection
        step = self._counters[layout.name] + 1 - protection.counter_first
        self._counters[layout.name] = protection.counter_first + step % protection.counter_count


def raw_values(
    kind: str, channels: Sequence[Channel], values: Mapping[str, float]
) -> dict[str, float]:
    """Raw value of every channel; `RangeError` names kind, channel, limits and value.

    Never clipped: a value that the frame cannot carry is refused.
    """
    raw = {}
    for channel in channels:
        value = values[channel.name]
        if not channel.low <= value <= channel.high:  # refuses what is not a number, too
            raise RangeError(
                f"{kind} {channel.name} is {value}, {channel.signal} carries {channel.low:g} to "
                f"{channel.high:g}; nothing was sent"
            )
        raw[channel.signal] = channel.raw(value)
    return raw
