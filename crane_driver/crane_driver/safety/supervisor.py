"""The supervisor judges commands, latches faults, and ramps to neutral whatever is not allowed."""

import math
from collections import UserDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import NamedTuple, Self

from crane_driver import constants
from crane_driver.faults import IN_EVERY_STATE, Fault, FaultKind
from crane_driver.safety.commands import (
    CommandSeries,
    JointLimiter,
    RefusedError,
    SafetySettings,
    ramped,
)
from crane_driver.safety.plausibility import FaultyEncoders, JointEstimate, Substitution
from crane_model.machine import Machine


class SafetyState(StrEnum):
    """Commands reach the valves in ENABLED and in DEGRADED alone."""

    cause: str  # why they do not, or only slower; of a fault, the fault says it
    remedy: str

    def __new__(cls, word: str, cause: str = "", remedy: str = "") -> Self:
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
        *("degraded", "the position of a joint is estimated: speeds are limited"),
        "repair its encoder, disable, then substitute an empty joint",
    )
    LISTENING = (  # and in no other state before it is configured anew
        *("listening", "the driver only listens (parameter listen_only): it sends nothing"),
        "to move or stop the crane, use the program that commands it",
    )
    FAULT = "fault"  # ramped to neutral; latched until reset
    ESTOP = (  # neutral at once; latched until reset
        *("emergency stop", "the emergency stop of the driver was called"),
        "make sure that the crane may move, then call reset_fault",
    )


class Event(StrEnum):
    """Event that may change the state."""

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
"""Transitions outside the table do not happen: in particular only ENABLE leads to ENABLED."""

LETTING_THROUGH = frozenset({SafetyState.ENABLED, SafetyState.DEGRADED})
"""In these, commands reach the valves."""


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
        faults = [fault.fault for fault in self.values()]
        return next(
            (fault for fault in faults if fault.kind in IN_EVERY_STATE), next(iter(faults), None)
        )

    def add(self, fault: Fault) -> bool:
        key = f"{fault.kind} {fault.source}".strip()
        if key in self:
            self[key].count += 1
            return False
        self[key] = Latched(fault)
        return True


class Level(Enum):
    """How much it matters."""

    DEBUG = auto()  # a consequence of what was said
    INFO = auto()  # a state
    WARNING = auto()  # what was refused, and what devices report
    ERROR = auto()  # a fault


class LogEntry(NamedTuple):
    """One line of the log."""

    level: Level
    text: str


class Output(NamedTuple):
    """Commands to the valves."""

    commands: dict[str, float]  # joint: -1 to 1
    enabled: bool


class Supervisor:
    """All times are of the steady clock [s]; `now` never goes back."""

    def __init__(
        self,
        valves: Sequence[str],
        machine: Machine,
        settings: SafetySettings,
        now: float,
        listen_only: bool = False,
    ):
        """listen_only: nothing can be sent to the valves, of which there are none then."""
        self._valves, self._settings = tuple(valves), settings
        self._limiters = {
            joint: JointLimiter(machine.limits[joint], settings.deceleration[joint], settings)
            for joint in valves
        }
        self._output = dict.fromkeys(self._valves, 0.0)
        self._position: dict[str, float] = {}
        self._velocity: dict[str, float] = {}
        self._substitution: Substitution | None = None
        self._faulty_encoders = FaultyEncoders()
        self._stepped = now
        self._troubled = now  # when the last fault of the bus was seen
        self.state = SafetyState.LISTENING if listen_only else SafetyState.OFFLINE
        self.commands = CommandSeries(self._valves, settings)
        self.faults = LatchedFaults()
        self.limited: dict[str, float] = {}  # commands that the limits of Table 2 held back
        self.log: list[LogEntry] = []  # for the log

    @property
    def cause(self) -> str:
        """Why commands do not reach the valves, or only slower; empty while nothing is wrong."""
        fault = self.faults.first
        if fault and self.state is SafetyState.FAULT:
            return str(fault)
        joint, problem = self.substituted, self._estimate_problem(self._stepped)
        if self.state is SafetyState.DEGRADED:
            return f"{joint}: {self.state.cause}"
        if joint and self.state is SafetyState.OFFLINE and problem:
            return f"{self.state.cause}; {joint}: {problem}"
        return self.state.cause

    @property
    def remedy(self) -> str:
        fault = self.faults.first
        return fault.remedy if fault and self.state is SafetyState.FAULT else self.state.remedy

    def line(self, fault: Fault) -> str:
        """One line for log and people: cause, consequence, remedy."""
        if self.state is SafetyState.LISTENING:
            return f"{fault}: {fault.remedy}"
        return fault.line

    def command(self, names: Sequence[str], values: Sequence[float], received: float) -> None:
        """Take a command that came at `received`; `RefusedError` if it is refused as a whole."""
        if self.letting_through:
            self._judge_age(received)  # first: a command that comes too late repairs nothing
        self.commands.take(names, values, received, moves=self.letting_through)

    def published_by(self, count: int) -> None:
        self.commands.publishers = count
        if self.commands.several and self.letting_through:
            self._latch(Fault(FaultKind.SEVERAL_PUBLISHERS, self.commands.several))

    def readings(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        self._position, self._velocity = dict(positions), dict(velocities)

    @property
    def letting_through(self) -> bool:
        return self.state in LETTING_THROUGH

    @property
    def substituted(self) -> str:
        """The joint whose encoder is not believed; empty if there is none."""
        return self._substitution.joint if self._substitution else ""

    def substitute(self, joint: str) -> None:
        """Go on without the encoder of a joint, or with all if empty; `RefusedError` if not."""
        asked = f"no substitute for {joint}" if joint else "the substitute is not taken back"
        self._refuse_listening(asked)
        if self.letting_through or any(self._output.values()):
            raise RefusedError(f"{asked}: the crane is {self.state}; disable first, at rest")
        if not joint:
            self._substitution = None
            return
        if self.substituted not in ("", joint):
            raise RefusedError(
                f"{asked}: {self.substituted} has one already, and one joint at most may; take "
                "that back with an empty joint first"
            )
        self._substitution = Substitution.permitted(joint, self._valves, self._settings.degraded)
        self.log.append(LogEntry(Level.WARNING, f"{joint}: its encoder is no longer used"))

    def estimated(self, estimate: JointEstimate, now: float) -> None:
        if self._substitution:
            self._substitution.tell(estimate, now)

    @property
    def sent(self) -> Mapping[str, float]:
        """Last commands of the valves, -1 to 1 by joint."""
        return self._output

    def not_believed(self, faults: Iterable[Fault]) -> None:
        """Positions that cannot be true; offline, nothing moves by them."""
        if self.state is not SafetyState.OFFLINE:
            for fault in faults:
                self._latch(fault)

    def encoders_found_faulty(self, told: Mapping[str, str], before: bool) -> None:
        """Positions that the sensor monitor found wrong; `before`: before the driver began."""
        faults, warnings = self._faulty_encoders.take(told, before)
        self.log += [LogEntry(Level.WARNING, text) for text in warnings]
        self.not_believed(fault for fault in faults if fault.source != self.substituted)

    def stalled(self, fault: Fault, now: float) -> None:
        """The driver itself did not run; offline, nothing moves meanwhile."""
        self._troubled = now
        if self.state is not SafetyState.OFFLINE:
            self._latch(fault)

    def can_faults(self, faults: Iterable[Fault], now: float) -> None:
        for fault in faults:
            self._troubled = now
            if self.state is SafetyState.OFFLINE and fault.kind not in IN_EVERY_STATE:
                continue  # not well as yet, which is what this state says
            self._latch(fault)

    def ready(self, complete: bool, now: float) -> None:
        """Return whether all messages of the machine come in time."""
        well = now - self._troubled > self._settings.settling_time
        if self.state is SafetyState.OFFLINE and complete and well and not self._unknown(now):
            self._happen(Event.READY)

    def enable(self, now: float) -> None:
        """Let commands through from now on; `RefusedError` says what is in the way."""
        if (self.state, Event.ENABLE) not in TRANSITIONS:
            why = (f"not enabled: the state is {self.state}", self.cause, self.remedy)
            raise RefusedError("; ".join(filter(None, why)))
        if self.commands.several:
            raise RefusedError(f"not enabled: {self.commands.several}; stop all but one")
        if any(self._output.values()):
            raise RefusedError("not enabled: the valves are not neutral yet")
        if self.commands.fresh(now) and not self.commands.is_neutral:
            raise RefusedError(
                f"not enabled: the command is {self.commands}; command neutral first"
            )
        if problem := self._estimate_problem(now):
            raise RefusedError(f"not enabled: {self.substituted}: {problem}")
        if problem := self._faulty_encoders.problem(self.substituted):
            raise RefusedError(f"not enabled: {problem}")
        self.commands.begin(now)
        degraded = self._settings.degraded if self._substitution else None
        for limiter in self._limiters.values():
            limiter.restart(degraded.speed if degraded else 1.0)
        self._happen(Event.ENABLE_DEGRADED if degraded else Event.ENABLE)

    def disable(self) -> None:
        """Ramp to neutral and let no more commands through; in other states nothing changes.

        `RefusedError` if the driver only listens.
        """
        self._refuse_listening("not disabled")
        if self.letting_through:
            self._happen(Event.DISABLE)

    def emergency_stop(self) -> None:
        """Neutral at once, latched; `RefusedError` if the driver only listens."""
        self._refuse_listening("the crane is not stopped")
        self._output = dict.fromkeys(self._valves, 0.0)
        self._happen(Event.EMERGENCY_STOP)

    def reset(self, now: float) -> None:
        """Forget the faults; never enables. `RefusedError` while the ramp to neutral runs."""
        if any(self._output.values()):
            raise RefusedError("not reset: the valves are not neutral yet")
        self.faults.clear()
        if (self.state, Event.RESET) in TRANSITIONS:
            self._troubled = now
            self._happen(Event.RESET)

    def output(self, now: float) -> Output:
        """Commands to send at `now`; call it in every cycle."""
        dt = min(now - self._stepped, constants.LONGEST_STEP_S)
        self._stepped = now
        if self.letting_through:
            self._judge_age(now)
        if self.letting_through and (problem := self._estimate_problem(now)):
            self._latch(Fault(FaultKind.ESTIMATE, problem, self.substituted))
        if self.letting_through and (unknown := self._unknown(now)):
            no_state = f"no position and velocity of {', '.join(unknown)}"
            self._latch(Fault(FaultKind.NO_STATE, no_state))
        if self.letting_through:
            self._output = self._within_limits(dt, now)
        else:
            step = dt / self._settings.ramp_time
            self._output = {name: ramped(value, step) for name, value in self._output.items()}
            self.limited = {}
        moving = any(self._output.values())
        return Output(dict(self._output), self.letting_through or moving)

    def _judge_age(self, now: float) -> None:
        if fault := self.commands.overdue(now):
            self._latch(fault)

    def _within_limits(self, dt: float, now: float) -> dict[str, float]:
        position, velocity = dict(self._position), dict(self._velocity)
        target = self.commands.target
        if substitution := self._substitution:
            position[substitution.joint] = substitution.towards(target[substitution.joint], now)
            velocity[substitution.joint] = substitution.motion(now)[1]
        output = {
            joint: self._limiters[joint].limit(target[joint], position[joint], velocity[joint], dt)
            for joint in self._valves
        }
        self.limited = {joint: value for joint, value in output.items() if value != target[joint]}
        return output

    def _unknown(self, now: float) -> list[str]:
        motions = {
            joint: (self._position.get(joint, math.nan), self._velocity.get(joint, math.nan))
            for joint in self._valves
        }
        if substitution := self._substitution:
            motions[substitution.joint] = substitution.motion(now)
        return [joint for joint, motion in motions.items() if not math.isfinite(sum(motion))]

    def _estimate_problem(self, now: float) -> str:
        return self._substitution.problem(now) if self._substitution else ""

    def _refuse_listening(self, asked: str) -> None:
        if self.state is SafetyState.LISTENING:
            raise RefusedError(f"{asked}: {self.state.cause}; {self.state.remedy}")

    def _latch(self, fault: Fault) -> None:
        if self.faults.add(fault):
            level = Level.ERROR if fault is self.faults.first else Level.DEBUG
            if self.state is SafetyState.LISTENING:
                level = Level.WARNING  # nothing follows from it
            self.log.append(LogEntry(level, self.line(fault)))
        if (self.state, Event.FAULT) in TRANSITIONS:
            self._happen(Event.FAULT)

    def _happen(self, event: Event) -> None:
        previous, self.state = self.state, TRANSITIONS[self.state, event]
        if self.state not in (previous, SafetyState.FAULT):  # a fault has been said
            self.log.append(LogEntry(Level.INFO, f"{previous} -> {self.state}"))
        if not self.letting_through:
            self.commands.end()
