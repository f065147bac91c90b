"""The states of the driver and all that leads from one to another, as one table."""

from enum import StrEnum
from typing import Self


class State(StrEnum):
    """Commands reach the valves in ENABLED alone."""

    cause: str  # why they do not; of a fault, the fault says it
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
    FAULT = "fault"  # ramped to neutral; latched until reset
    ESTOP = (  # neutral at once; latched until reset
        *("emergency stop", "the emergency stop of the driver was called"),
        "make sure that the crane may move, then call reset_fault",
    )


class Event(StrEnum):
    """What may change the state."""

    READY = "ready"
    ENABLE = "enable"
    DISABLE = "disable"
    FAULT = "fault"
    EMERGENCY_STOP = "emergency stop"
    RESET = "reset"


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.OFFLINE, Event.READY): State.DISABLED,
    (State.DISABLED, Event.ENABLE): State.ENABLED,
    (State.ENABLED, Event.DISABLE): State.DISABLED,
    (State.OFFLINE, Event.FAULT): State.FAULT,  # only what is wrong in every state
    (State.DISABLED, Event.FAULT): State.FAULT,
    (State.ENABLED, Event.FAULT): State.FAULT,
    # Not to DISABLED: whether the machine is well has to be seen anew.
    (State.FAULT, Event.RESET): State.OFFLINE,
    (State.ESTOP, Event.RESET): State.OFFLINE,
    **{(state, Event.EMERGENCY_STOP): State.ESTOP for state in State},
}
"""What is not in the table does not happen: in particular nothing but ENABLE leads to ENABLED."""
