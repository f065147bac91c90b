"""Every fault of the driver: its number, its cause, its remedy.

The log, driver/state, /diagnostics and the manual's table of faults take their words from here.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Self


class FaultKind(StrEnum):
    """Kind of a fault. The value names it in texts; FAULT_ and the member's name make its constant
    in crane_interfaces/DriverState.
    """

    number: int  # of that constant: never changed, since bags hold it
    cause: str
    remedy: str  # what to do before reset_fault

    def __new__(cls, word: str, number: int, cause: str, remedy: str) -> Self:
        kind = str.__new__(cls, word)
        kind._value_ = word
        kind.number, kind.cause, kind.remedy = number, cause, remedy
        return kind

    WRONG_SIZE = (
        *("wrong size", 1, "the size of a frame differs from the DBC file"),
        "compare the DBC file with the firmware of the device",
    )
    CHECKSUM = (
        *("checksum", 2, "a frame fails its CRC"),
        "check wiring and termination, and the CRC in the mapping",
    )
    REPEATED = (
        *("repeated", 3, "a frame came twice, by its counter, or from two devices"),
        "look for a gateway or a second device that sends it",
    )
    SEQUENCE = (
        *("sequence", 4, "frames were lost in a row, or a counter is impossible"),
        "check wiring and load of the bus",
    )
    OUT_OF_RANGE = (
        *("out of range", 5, "a reading is out of its range"),
        "check the sensor and its plug, and the range in the mapping",
    )
    SENSOR = (
        *("sensor", 6, "a device reports that its reading is not a measurement"),
        "check the sensor and its plug",
    )
    STATE = (
        *("state", 7, "a device reports that it is not healthy"),
        "look up this state in the manual of the device",
    )
    LATE = (
        *("late", 8, "a message comes late"),
        "check plug and supply of its device, and the load of bus and computer",
    )
    MISSING = (
        *("missing", 9, "a message no longer arrives"),
        "check plug and supply of its device",
    )
    BUS = (*("bus", 10, "the CAN bus cannot be used"), "check adapter, wiring and termination")
    NOT_ACCEPTED = (
        *("not accepted", 11, "the valve electronics do not accept the commands"),
        "check the wiring of the valve electronics, and CRC and counter in the mapping",
    )
    OVERFLOW = (
        *("overflow", 12, "frames came faster than they were taken"),
        "find what floods the bus, or stop other programs on this computer",
    )
    HEARTBEAT = (
        *("heartbeat", 13, "a CANopen device no longer sends its heartbeat"),
        "check plug and supply of the device",
    )
    REBOOT = (
        *("reboot", 14, "a CANopen device has rebooted in operation"),
        "check its supply, and what resets it",
    )
    NOT_OPERATIONAL = (
        *("not operational", 15, "a CANopen device has left operation"),
        "find the sender of the command",
    )
    FOREIGN = (
        *("foreign command", 16, "a valve frame on the bus that this driver did not send"),
        "take every other sender of valve commands off the bus",
    )
    EMERGENCY = (
        *("emergency", 17, "a CANopen device reports an emergency"),
        "look up its code in the manual of the device",
    )
    COMMAND_TIMEOUT = (
        *("command timeout", 18, "commands stopped before they were neutral"),
        "see why the node that commands the valves ended or fell behind",
    )
    SEVERAL_PUBLISHERS = (
        *("several publishers", 19, "more than one node commands the valves"),
        "stop all but one",
    )
    NO_STATE = (
        *("no state", 20, "position or velocity of a joint is not known"),
        "check its encoder and plug, and the load of bus and computer",
    )
    FROZEN = (
        *("frozen", 21, "a position does not change although the joint is driven"),
        "check that the encoder turns, the joint is free and the engine runs",
    )
    JUMPED = (
        *("jumped", 22, "a position changes faster than the joint can move"),
        "check encoder and wiring",
    )
    STALLED = (
        *("stalled", 23, "the driver was not given the processor in time"),
        "give it real-time priority (realtime.priority), or stop other work and floods of frames",
    )
    OVERWORKED = (
        *("overworked", 24, "the driver's own work took too long"),
        "find what comes all at once, or take a faster processor",
    )
    ESTIMATE = (
        *("estimate", 25, "the estimate that replaces an encoder can no longer be used"),
        "see what position_estimator says on /diagnostics",
    )
    FAULTY_ENCODER = (
        *("faulty encoder", 26, "the sensor monitor has found an encoder that is or may be faulty"),
        "repair the encoder and let sensor_monitor forget it, or continue without it by substitute",
    )


UNUSABLE = frozenset({FaultKind.WRONG_SIZE, FaultKind.CHECKSUM, FaultKind.REPEATED})
"""Faults after which nothing in the frame may be used."""

IN_EVERY_STATE = frozenset({FaultKind.FOREIGN})
"""Faults even while the driver is offline; they come before others, of which they are never a
consequence.
"""


@dataclass(frozen=True)
class Fault:
    """One fault of the driver.

    Parameters
    ----------
    kind
        Kind of the fault, with its cause and its remedy.
    detail
        What was found, with the limit.
    source, id, measures
        Message, device or joint, empty for the whole driver or bus; identifier of a message, as
        candump writes it; what it measures, for people: "encoder of boom".
    reading
        Reading that is not a measurement: joint, JOINT.a, ..., supply.
    advice
        What to do, if the remedy of the kind does not fit.

    Examples
    --------
    >>> fault = Fault(FaultKind.JUMPED, "its position jumped by 0.2 in 5 ms", "boom")
    >>> print(fault)
    boom: jumped: its position jumped by 0.2 in 5 ms
    >>> fault.remedy
    'check encoder and wiring, then call reset_fault'
    """

    kind: FaultKind
    detail: str
    source: str = ""
    id: str = ""
    measures: str = ""
    reading: str = ""
    advice: str = ""

    @property
    def where(self) -> str:
        source = f"{self.source} ({self.id})" if self.id else self.source
        return ", ".join(filter(None, (self.measures, source)))

    @property
    def line(self) -> str:
        """One line for log and people: cause, consequence, remedy."""
        return f"{self}: valves neutral; {self.remedy}"

    @property
    def remedy(self) -> str:
        return f"{self.advice or self.kind.remedy}, then call reset_fault"

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.where, self.kind, self.detail)))
