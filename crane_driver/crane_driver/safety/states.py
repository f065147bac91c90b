"""The states of the driver and all that leads from one to another, as one table."""

from enum import StrEnum


class State(StrEnum):
    """Commands reach the valves in ENABLED alone."""

    OFFLINE = "offline"  # the readings of the machine are not complete, or not yet
    DISABLED = "disabled"
    ENABLED = "enabled"
    FAULT = "fault"  # ramped to neutral; latched until reset
    ESTOP = "emergency stop"  # neutral at once; latched until reset


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
