"""CAN frames, and those by which the simulated crane and its driver advance in lock-step.

On simulated time, after the readings of each cycle, the crane sends the time at which it took them.
It goes on only when the driver has sent that time back, behind the valve frames that answer the
readings. So the load of the computer changes how long a cycle takes, and nothing else. Both frames
have identifiers of their own.
"""

import math
from typing import NamedTuple

TIME, STEP = 0x1FC0DE01, 0x1FC0DE02  # extended identifiers: of the crane, of the driver
START_NS = 1_000_000_000  # of the first cycle; a ROS time of 0 stands for an unknown one
LENGTH = 8  # bytes


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


def time_frame(time: int) -> Frame:
    """Frame by which the crane says that the readings of `time` [ns] have been sent."""
    return Frame(TIME, time.to_bytes(LENGTH, "little"), extended=True)


def step_frame(time: int) -> Frame:
    """Frame by which the driver says that the valve frames for `time` [ns] have been sent."""
    return Frame(STEP, time.to_bytes(LENGTH, "little"), extended=True)


def told_time(frame: Frame, identifier: int) -> int | None:
    """Time [ns] that a frame with the identifier tells; None for any other frame."""
    if frame.id != identifier or not frame.extended or len(frame.data) != LENGTH:
        return None
    return int.from_bytes(frame.data, "little")
