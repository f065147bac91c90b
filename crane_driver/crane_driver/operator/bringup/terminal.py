"""Questions to the operator, answered by lines, while the crane is still being listened to."""

import os
import select
import sys
from collections.abc import Callable

from crane_model.errors import CraneError, DataError
from crane_nodes.context import Stop

PAUSE = 0.02  # s


class NotConfirmedError(CraneError):
    """The operator did not say yes; the step ends."""


class BringupTerminal:
    """Reads standard input, from a terminal or from a file of answers.

    idle: what is done while waiting, for at most the time it is given [s].
    """

    def __init__(self, stop: Stop, idle: Callable[[float], None]):
        self._stop, self._idle = stop, idle
        self._read = b""

    def say(self, text: str = "") -> None:
        """Print."""
        print(text, flush=True)

    def ask(self, question: str) -> str:
        """The next line; `DataError` if there is none, `KeyboardInterrupt` on a signal."""
        print(f"{question} > ", end="", flush=True)
        while b"\n" not in self._read:
            self._idle(PAUSE)
            if self._stop.requested:
                raise KeyboardInterrupt
            if not select.select([sys.stdin], [], [], 0.0)[0]:
                continue
            part = os.read(sys.stdin.fileno(), 4096)
            if not part:
                raise DataError(f"no answer to '{question}': the input has ended")
            self._read += part
        line, self._read = self._read.split(b"\n", 1)
        if not sys.stdin.isatty():  # so that a log shows question and answer
            print(line.decode(errors="replace"), flush=True)
        return line.decode(errors="replace").strip()

    def number(self, question: str, low: float, high: float) -> float:
        """A number from `low` to `high`; asked again until it is one."""
        while (value := self.number_or_none(question, low, high)) is None:
            self.say("  a number is needed")
        return value

    def number_or_none(self, question: str, low: float, high: float) -> float | None:
        """The same; None where the answer is empty."""
        while answer := self.ask(question):
            try:
                value = float(answer)
            except ValueError:
                self.say(f"  '{answer}' is no number")
                continue
            if low <= value <= high:
                return value
            self.say(f"  {value:g} is not from {low:g} to {high:g}")
        return None

    def confirm(self, question: str) -> None:
        """`NotConfirmedError` unless the answer is yes."""
        if (answer := self.ask(f"{question} Type yes to go on")).casefold() != "yes":
            raise NotConfirmedError(
                f"not confirmed ('{answer}'); the step ends, nothing is written"
            )
