"""jog in a terminal of its own, its keys pressed as an operator would."""

import os
import pty
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from processes import DemoError, Processes

REPEAT_S = 1 / 30  # of a key that is held
PATIENCE_S = 60.0


class Keyboard:
    """Lives within a `with` block."""

    def __init__(self, suite: Processes, machine: str):
        self._suite, self._machine = suite, machine
        self._keys, self._terminal = pty.openpty()

    def __enter__(self) -> Self:
        self._suite.start(
            *("jog", "crane_driver", "jog", "--ros-args", "-p", f"machine:={self._machine}"),
            stdin=self._terminal,
        )
        self._suite.until(lambda: "emergency stop" in self._suite.said("jog"), "jog shows no keys")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._suite.stop("jog")
        os.close(self._terminal)
        os.close(self._keys)

    def press(self, key: str) -> None:
        """Once."""
        os.write(self._keys, key.encode())

    def hold(self, key: str, until: Callable[[], bool]) -> None:
        """As a terminal repeats it; `DemoError` where the crane does not get there."""
        end = time.monotonic() + PATIENCE_S
        pressed = -REPEAT_S
        while not until():
            self._suite.check()
            if time.monotonic() > end:
                raise DemoError(f"jog: '{key}' was held for {PATIENCE_S:g} s in vain")
            if time.monotonic() - pressed >= REPEAT_S:
                pressed = time.monotonic()
                self.press(key)
