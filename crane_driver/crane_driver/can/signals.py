"""What the DBC says of single signals, as the channels need it."""

import math
from enum import StrEnum

from cantools.database.can import Message, Signal

from crane_driver.can.dbc import may_be_j1939
from crane_driver.can.layout import Channel

LARGEST = 1.7e308  # stands for no limit: what is beyond is infinite or not a number
SLACK = 0.49  # steps, less than what rounds to the next one


class Code(StrEnum):
    """Meaning of a raw value of J1939 that is not a measurement."""

    NOT_AVAILABLE = "not available"
    ERROR = "error"
    RESERVED = "reserved"


CODES = {
    0xFF: Code.NOT_AVAILABLE,
    0xFE: Code.ERROR,
    **dict.fromkeys(range(0xFB, 0xFE), Code.RESERVED),
}
LARGEST_MEASUREMENT = {
    2: 2,
    10: 0x3FA,
    **{length: (0xFB << (length - 8)) - 1 for length in (8, 12, 16, 20, 24, 28, 32)},
}
"""Largest raw value that is not a code, by the length in bits. Source: SAE J1939-71, transmitted
signal ranges; states of two bits keep their error, 2, which nobody takes for a measurement."""


def code_of(length: int, raw: int) -> Code | None:
    """The code that a raw value of so many bits is; None if it is a measurement."""
    if raw <= LARGEST_MEASUREMENT.get(length, raw):
        return None
    if length <= 2:
        return Code.NOT_AVAILABLE
    return CODES[raw >> (length - 8) if length != 10 else raw & 0xFF]


def code_bits(message: Message, signal: Signal) -> int:
    """Bits of a signal whose greatest values are codes of J1939; 0 if they are measurements.

    They are codes if the message may be of J1939, and the DBC neither states a range, other than
    all that the bits hold, nor names such a value.
    """
    if not may_be_j1939(message) or signal.is_float or signal.is_signed:
        return 0
    greatest = 2**signal.length - 1
    if signal.minimum is not None and signal.maximum is not None:
        limits = (signal.minimum, signal.maximum)
        if max((one - signal.offset) / signal.scale for one in limits) < greatest - SLACK:
            return 0
    if any(code_of(signal.length, int(raw)) for raw in signal.choices or ()):
        return 0
    return signal.length if signal.length in LARGEST_MEASUREMENT else 0


def to_channel(
    name: str, signal: Signal, factor: float, shift: float, fault: str | None, bits: int = 0
) -> Channel:
    """Channel of a signal whose physical value times `factor` plus `shift` is the SI value.

    Of a signal whose greatest values are codes, `bits` is its length.
    """
    gain, offset = signal.scale * factor, signal.offset * factor + shift
    least, greatest = raw_limits(signal)
    if bits:
        greatest = LARGEST_MEASUREMENT[bits]
    ends = [gain * raw + offset for raw in (least, greatest)]
    # Limits are given in decimals, which the steps of the signal need not meet.
    slack = 0.0 if signal.is_float else SLACK * abs(gain)
    low, high = max(min(ends) - slack, -LARGEST), min(max(ends) + slack, LARGEST)
    return Channel(name, signal.name, gain, offset, low, high, fault, signal.is_float, bits)


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
    """Whether raw and physical value differ."""
    return signal.scale != 1 or signal.offset != 0


def fills_byte(signal: Signal) -> bool:
    """Whether the raw value is one whole byte of the frame."""
    first_bit = 0 if signal.byte_order == "little_endian" else 7
    return signal.length == 8 and signal.start % 8 == first_bit and not is_scaled(signal)
