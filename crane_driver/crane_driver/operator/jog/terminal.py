"""The terminal read key by key, and given back as it was."""

import os
import select
import sys
import termios
import time
import tty
from contextlib import suppress
from types import TracebackType
from typing import Self

from crane_model.errors import CraneError

LONGEST = 4096  # bytes read at once
IFLAG, CC = 0, 6  # places in what tcgetattr gives


class TerminalError(CraneError):
    """Keys cannot be read.

    Examples: standard input is a pipe or a file, the node was started by a launch file.
    """


class KeyTerminal:
    """Standard input. Keys come at once and unechoed; Ctrl-C still is a signal.

    Ctrl-Z and Ctrl-S are keys like others: they would hold up whoever sends commands.
    """

    def __init__(self) -> None:
        self._input = sys.stdin.fileno()
        if not os.isatty(self._input):
            raise TerminalError(
                "keys are read from a terminal, but standard input is none; start this in a "
                "terminal, by itself, or jog with a joystick: --joy"
            )
        self.closed = False  # the terminal has gone

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._input)
        tty.setcbreak(self._input)
        settings = termios.tcgetattr(self._input)
        settings[IFLAG] &= ~(termios.IXON | termios.ICRNL)
        settings[CC][termios.VSUSP] = b"\0"  # no key
        termios.tcsetattr(self._input, termios.TCSANOW, settings)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        # what was typed ahead was not meant for the shell
        with suppress(termios.error):  # the terminal has gone
            termios.tcsetattr(self._input, termios.TCSAFLUSH, self._before)

    def read(self, seconds: float) -> str:
        """What is typed, waiting for it at most so long; empty if nothing is."""
        ready, _, _ = select.select([self._input], [], [], max(0.0, seconds))
        if not ready:
            return ""
        try:
            data = os.read(self._input, LONGEST)
        except OSError:  # hung up
            data = b""
        self.closed = not data
        return data.decode(errors="replace")


class NoTerminal:
    """In the place of a terminal where a joystick does without."""

    closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        pass

    def read(self, seconds: float) -> str:
        """Nothing, after so long."""
        time.sleep(max(0.0, seconds))
        return ""
