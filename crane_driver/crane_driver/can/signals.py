"""What the DBC says of single signals, as the channels need it."""

import math

from cantools.database.can import Signal

from crane_driver.can.layout import Channel

LARGEST = 1.7e308  # stands for no limit: what is beyond is infinite or not a number
SLACK = 0.49  # steps, less than what rounds to the next one


def to_channel(
    name: str, signal: Signal, factor: float, shift: float, fault: str | None
) -> Channel:
    """Channel of a signal whose physical value times `factor` plus `shift` is the SI value."""
    gain, offset = signal.scale * factor, signal.offset * factor + shift
    ends = [gain * raw + offset for raw in raw_limits(signal)]
    # Limits are given in decimals, which the steps of the signal need not meet.
    slack = 0.0 if signal.is_float else SLACK * abs(gain)
    low, high = max(min(ends) - slack, -LARGEST), min(max(ends) + slack, LARGEST)
    return Channel(name, signal.name, gain, offset, low, high, fault, signal.is_float)


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
