"""From values to frames to be sent."""

from collections.abc import Mapping, Sequence

from crane_driver.can.bits import SignalBits
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Channel, MessageLayout
from crane_driver.can.protection import frame_crc
from crane_model.errors import RangeError


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
