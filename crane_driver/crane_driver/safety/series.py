"""Commands as they follow one another: of one publisher, from a neutral one on, none late."""

import math
from collections.abc import Sequence

from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.commands import RefusedError, check_command
from crane_driver.safety.settings import SafetySettings
from crane_model.errors import RangeError


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
