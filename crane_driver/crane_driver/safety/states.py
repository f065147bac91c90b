"""The states of the driver, latched faults, and what it says in its log."""

from collections import UserDict
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import NamedTuple, Self

from crane_driver.faults import IN_EVERY_STATE, Fault

# The states of the driver and all that leads from one to another, as one table.


class SafetyState(StrEnum):
    """Commands reach the valves in ENABLED and in DEGRADED alone."""

    cause: str  # why they do not, or only slower; of a fault, the fault says it
    remedy: str

    def __new__(cls, word: str, cause: str = "", remedy: str = "") -> Self:
        """A member with what belongs to it."""
        state = str.__new__(cls, word)
        state._value_ = word
        state.cause, state.remedy = cause, remedy
        return state

    OFFLINE = (
        *("offline", "not all messages and devices of the machine are there and in time"),
        "see /diagnostics for those that are not",
    )
    DISABLED = "disabled", "the driver is disabled", "call enable"
    ENABLED = "enabled"
    DEGRADED = (
        *("degraded", "a joint goes on by an estimate: speeds are limited"),
        "mend its encoder, disable, then substitute an empty joint",
    )
    LISTENING = (  # and in no other state before it is configured anew
        *("listening", "the driver only listens (parameter listen_only): it sends nothing"),
        "to move or stop the crane, use what commands it",
    )
    FAULT = "fault"  # ramped to neutral; latched until reset
    ESTOP = (  # neutral at once; latched until reset
        *("emergency stop", "the emergency stop of the driver was called"),
        "make sure that the crane may move, then call reset_fault",
    )


class Event(StrEnum):
    """What may change the state."""

    READY = "ready"
    ENABLE = "enable"
    ENABLE_DEGRADED = "enable degraded"  # an encoder is substituted
    DISABLE = "disable"
    FAULT = "fault"
    EMERGENCY_STOP = "emergency stop"
    RESET = "reset"


TRANSITIONS: dict[tuple[SafetyState, Event], SafetyState] = {
    (SafetyState.OFFLINE, Event.READY): SafetyState.DISABLED,
    (SafetyState.DISABLED, Event.ENABLE): SafetyState.ENABLED,
    (SafetyState.DISABLED, Event.ENABLE_DEGRADED): SafetyState.DEGRADED,
    (SafetyState.ENABLED, Event.DISABLE): SafetyState.DISABLED,
    (SafetyState.DEGRADED, Event.DISABLE): SafetyState.DISABLED,
    (SafetyState.OFFLINE, Event.FAULT): SafetyState.FAULT,  # only what is wrong in every state
    (SafetyState.DISABLED, Event.FAULT): SafetyState.FAULT,
    (SafetyState.ENABLED, Event.FAULT): SafetyState.FAULT,
    (SafetyState.DEGRADED, Event.FAULT): SafetyState.FAULT,
    # Not to DISABLED: whether the machine is well has to be seen anew.
    (SafetyState.FAULT, Event.RESET): SafetyState.OFFLINE,
    (SafetyState.ESTOP, Event.RESET): SafetyState.OFFLINE,
    **{
        (state, Event.EMERGENCY_STOP): SafetyState.ESTOP
        for state in SafetyState
        if state is not SafetyState.LISTENING
    },
}
"""What is not in the table does not happen: in particular nothing but ENABLE leads to ENABLED."""

LETTING_THROUGH = frozenset({SafetyState.ENABLED, SafetyState.DEGRADED})
"""In these, commands reach the valves."""


# Faults, kept until they are reset.


@dataclass
class Latched:
    """A fault since the last reset: what was said first, and how often it came."""

    fault: Fault
    count: int = 1


class LatchedFaults(UserDict[str, Latched]):
    """By kind and source, in the order in which they came first."""

    @property
    def first(self) -> Fault | None:
        """The one that is told: others that are latched follow from it, most of the time."""
        faults = [one.fault for one in self.values()]
        return next((one for one in faults if one.kind in IN_EVERY_STATE), next(iter(faults), None))

    def add(self, fault: Fault) -> bool:
        """Whether it is a new one."""
        key = f"{fault.kind} {fault.source}".strip()
        if key in self:
            self[key].count += 1
            return False
        self[key] = Latched(fault)
        return True


# What the driver has to say in its log.


class Level(Enum):
    """How much it matters."""

    DEBUG = auto()  # a consequence of what was said
    INFO = auto()  # a state
    WARNING = auto()  # what was refused, and what devices report
    ERROR = auto()  # a fault


class News(NamedTuple):
    """One line of the log."""

    level: Level
    text: str
