"""Valve commands as they come: checked as a whole, one after another, ramped to neutral."""

import math
from collections.abc import Collection, Sequence

from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.limits import SafetySettings
from crane_model.errors import ConfigurationError, CraneError, RangeError

# Spool commands as they come: checked as a whole, and how they go back to neutral.


class RefusedError(CraneError):
    """A request to the driver was refused; nothing has changed.

    Examples: enabling while a command is not neutral, resetting while the ramp runs, a command
    with a value that is not a number.
    """


def check_valves(valves: Sequence[str], positions: Sequence[str]) -> None:
    """`ConfigurationError` where a joint has a valve but no position to keep its limits by."""
    if blind := [joint for joint in valves if joint not in positions]:
        raise ConfigurationError(
            f"mapping: {', '.join(blind)} can be commanded, but there is no position to keep the "
            "limits of Table 2 by; map one, or take the command out"
        )


def check_command(
    names: Sequence[str], values: Sequence[float], valves: Collection[str]
) -> dict[str, float]:
    """The commands by joint; joints of `valves` that are not named are neutral.

    `RangeError` refuses the whole command and names the joint, the limits and the value.
    """
    if len(names) != len(values):
        raise RangeError(
            f"valve command has {len(names)} names and {len(values)} values; one value a name"
        )
    commands = dict.fromkeys(valves, 0.0)
    seen: set[str] = set()
    for name, value in zip(names, values, strict=True):
        if name not in commands:
            raise RangeError(
                f"valve command for '{name}', but there are valves for {', '.join(valves)}"
            )
        if name in seen:
            raise RangeError(f"valve command names {name} twice")
        if not -1.0 <= value <= 1.0:  # refuses what is not a number, too
            raise RangeError(f"valve command for {name} is {value}, limits -1 and 1")
        seen.add(name)
        commands[name] = float(value)
    return commands


def ramped(command: float, step: float) -> float:
    """A spool command that is `step` nearer to neutral, and never beyond it."""
    return max(command - step, 0.0) if command > 0.0 else min(command + step, 0.0)


# Commands as they follow one another: of one publisher, from a neutral one on, none late.


class CommandSeries:
    """Times are of the steady clock [s]."""

    def __init__(self, valves: Sequence[str], settings: SafetySettings):
        self._valves, self._settings = tuple(valves), settings
        self._received = -math.inf  # when the last good command came
        self._from_neutral = False  # whether a neutral command has begun the present series
        self.target = dict.fromkeys(self._valves, 0.0)
        self.publishers = 0
        self.refused = 0  # commands
        self.refusal = ""  # why the last one was

    @property
    def is_neutral(self) -> bool:
        """Whether nothing is to move."""
        return all(abs(value) <= self._settings.neutral for value in self.target.values())

    @property
    def several(self) -> str:
        """Says that several publish, where they do."""
        return f"{self.publishers} publishers command the valves" if self.publishers > 1 else ""

    def __str__(self) -> str:
        """What is commanded."""
        return ", ".join(f"{joint} {value:.3g}" for joint, value in self.target.items() if value)

    def take(
        self, names: Sequence[str], values: Sequence[float], received: float, moves: bool
    ) -> None:
        """Take a command that came at `received`; `RefusedError` if it is refused as a whole.

        moves: whether commands reach the valves; then a series begins with a neutral one.
        """
        before = self.target
        try:
            if self.several:
                raise RangeError(f"{self.several}, one may")
            self.target = check_command(names, values, self._valves)
            begun = (moves and self._from_neutral) or self.is_neutral
            if moves and not begun:
                raise RangeError(
                    f"the first command is {self}; begin with a neutral one, at most "
                    f"{self._settings.neutral}"
                )
        except RangeError as error:
            self.target = before
            self.refused += 1
            self.refusal = f"{error}; the whole command is refused"
            raise RefusedError(self.refusal) from None
        self._from_neutral, self._received = begun, received

    def fresh(self, now: float) -> bool:
        """Whether the last command is not too old."""
        return now - self._received <= self._settings.command_timeout

    def begin(self, now: float) -> None:
        """From now on commands reach the valves."""
        self._from_neutral = self.fresh(now)

    def end(self) -> None:
        """They do no more."""
        self._from_neutral = False

    def overdue(self, now: float) -> Fault | None:
        """End where no command comes any more: well, if the last was neutral, else with a fault."""
        if self.fresh(now):
            return None
        fault = None
        if self._from_neutral and not self.is_neutral:
            detail = (
                f"last command {(now - self._received) * 1e3:.0f} ms ago, limit "
                f"{self._settings.command_timeout * 1e3:.0f} ms, it was {self}"
            )
            fault = Fault(FaultKind.COMMAND_TIMEOUT, detail)
        self.end()
        self.target = dict.fromkeys(self._valves, 0.0)
        return fault
