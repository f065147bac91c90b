"""jog in a terminal of its own, its keys pressed as an operator would."""

import math
import os
import pty
from collections.abc import Callable
from typing import Self

from crane_benchmark.rehearsal.processes import ProcessError, Processes

REPEAT_S = 1 / 30  # of a key that is held
HELD_S, LET_GO_S = 3.0, 0.3  # jog, where it paused itself, wants keys let go before they count
PATIENCE_S = 60.0


class Keyboard:
    """Lives within a `with` block."""

    def __init__(self, suite: Processes, machine: str, clock: Callable[[], float]):
        """Keys are held by the time of `clock` [s], which is that of the crane."""
        self._suite, self._machine, self._clock = suite, machine, clock
        self._keys, self._terminal = pty.openpty()

    def __enter__(self) -> Self:
        self._suite.start(
            *("jog", "crane_driver", "jog", "--ros-args", "-p", f"machine:={self._machine}"),
            *self._suite.clock,
            stdin=self._terminal,
        )
        self._suite.until(lambda: "emergency stop" in self._suite.said("jog"), "jog shows no keys")
        return self

    def __exit__(self, *_: object) -> None:
        self._suite.stop("jog")
        os.close(self._terminal)
        os.close(self._keys)

    def press(self, key: str) -> None:
        """Once."""
        os.write(self._keys, key.encode())

    def hold(self, key: str, until: Callable[[], bool]) -> None:
        """As a terminal repeats it; `ProcessError` where the crane does not get there."""
        begin = self._clock()
        pressed = -math.inf
        while not until():
            self._suite.check()
            now = self._clock()
            if now > begin + PATIENCE_S:
                raise ProcessError(f"jog: '{key}' was held for {PATIENCE_S:g} s in vain")
            held = (now - begin) % (HELD_S + LET_GO_S) < HELD_S
            if held and now - pressed >= REPEAT_S:
                pressed = now
                self.press(key)
