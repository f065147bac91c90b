"""What passes through the CAN layer: frames, and the faults that are found in them."""

import math
from dataclasses import dataclass
from enum import StrEnum
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


class FaultKind(StrEnum):
    """What can be wrong with the stream of frames."""

    WRONG_SIZE = "wrong size"
    CHECKSUM = "checksum"
    REPEATED = "repeated"
    SEQUENCE = "sequence"  # frames lost in between, or a counter that does not exist
    OUT_OF_RANGE = "out of range"
    SENSOR = "sensor"  # the device says that its reading is no measurement
    STATE = "state"  # the device says that it is not healthy
    LATE = "late"
    MISSING = "missing"
    BUS = "bus"
    NOT_ACCEPTED = "not accepted"  # command frames, by the machine
    OVERFLOW = "overflow"  # frames dropped because nobody took them
    HEARTBEAT = "heartbeat"  # of a CANopen device: lost
    REBOOT = "reboot"  # of a CANopen device in operation
    NOT_OPERATIONAL = "not operational"  # a CANopen device that was
    FOREIGN = "foreign command"  # a valve frame that this driver did not send
    EMERGENCY = "emergency"  # message of a CANopen device


UNUSABLE = frozenset({FaultKind.WRONG_SIZE, FaultKind.CHECKSUM, FaultKind.REPEATED})
"""Faults after which nothing in the frame may be used."""


@dataclass(frozen=True)
class Fault:
    """One named fault; `message` and `id` say where, unless it is of the whole bus."""

    kind: FaultKind
    detail: str
    message: str = ""
    id: str = ""  # as `show_id` writes it

    def __str__(self) -> str:
        where = f"{self.message} ({self.id}): " if self.message else ""
        return f"{where}{self.kind}: {self.detail}"
