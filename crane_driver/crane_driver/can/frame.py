"""What passes through the CAN layer."""

import math
from typing import NamedTuple


class Frame(NamedTuple):
    """One CAN frame. Stamps are those of reception; a frame to be sent has none."""

    id: int
    data: bytes
    extended: bool = False  # 29-bit identifier
    stamp: int = 0  # ns since the epoch, the clock of messages
    steady: float = math.nan  # s of time.monotonic, the clock of watchdogs


def show_id(identifier: int, extended: bool) -> str:
    """An identifier as candump writes it: 3 hexadecimal digits, 8 where it is extended."""
    return f"{identifier:08X}" if extended else f"{identifier:03X}"
