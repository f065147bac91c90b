"""What keyboard and joystick ask for, and the terminal read key by key."""

import math
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from types import TracebackType
from typing import NamedTuple, Self

from crane_driver.operator.jog.motion import Demand
from crane_model.errors import CraneError

# What typed characters ask for. A terminal tells of keys that go down, never of keys let go: a
# joint moves only while characters of its key keep coming.

PAIRS = (
    *(("h", "l"), ("j", "k"), ("u", "i"), ("n", "m")),
    *(("f", "g"), ("c", "v"), ("a", "s"), ("t", "y")),
)
"""Keys of the joints from the base to the tip: down, up. Further joints have a joystick alone."""

STEPS = "123456789"
FIRST_STEP = 3
STOP = "x"


class Request(StrEnum):
    """What else a key may ask for; the services of the driver by their names."""

    ENABLE = "enable"
    DISABLE = "disable"
    RESET = "reset_fault"
    EMERGENCY_STOP = "emergency_stop"
    QUIT = "quit"


REQUESTS = {
    "e": Request.ENABLE,
    "d": Request.DISABLE,
    "r": Request.RESET,
    STOP: Request.EMERGENCY_STOP,
    "q": Request.QUIT,
}
CONTROLS = {str(request): key for key, request in REQUESTS.items()}


class Keyboard:
    """Each character of a joint's key holds the joint for `hold` seconds (steady clock).

    So a tap is a nudge of that length. A key that is held moves the joint so long, then the joint
    waits for the first repeat of the terminal, and goes on while repeats come. Every other key, and
    what comes at once with other characters, such as pasted text, lets the joint go.
    """

    def __init__(self, hold: float, joints: Sequence[str]):
        self._hold = hold
        self.pairs = dict(zip(joints, PAIRS, strict=False))
        self._keys = {
            key: (joint, direction)
            for joint, pair in self.pairs.items()
            for key, direction in zip(pair, (-1, 1), strict=True)
        }
        self._joint, self._direction = "", 0
        self._until = -math.inf
        self.step = FIRST_STEP  # tenths of the fastest

    def typed(self, text: str, now: float) -> Request | None:
        """Take the characters that came at once, one or more."""
        if not text:
            return None
        self._until = -math.inf
        if STOP in text:  # even within what an arrow or Alt sends: one too many harms nobody
            return Request.EMERGENCY_STOP
        (key, *others) = set(text)
        if others:
            return None
        if key in self._keys:
            self._joint, self._direction = self._keys[key]
            self._until = now + self._hold
        elif key in STEPS:
            self.step = int(key)
        return REQUESTS.get(key)

    def demand(self, now: float) -> Demand | None:
        """What is held at `now`."""
        if now >= self._until:
            return None
        return Demand(self._joint, self._direction * self.step / 10)


# What a joystick asks for: only while its deadman button is held.

SILENCE = 0.1  # s
CENTRE = 0.1  # an axis within it is at rest


class Axis(NamedTuple):
    """Where the axis of a joint is in a message, and which way is positive."""

    number: int
    sign: int


class Joystick:
    """All times are of the steady clock [s].

    The deadman button counts once all axes have been at their centres while it was held; letting it
    go, silence for more than `SILENCE` and an axis that is not finite let the joint go. The axis
    that is pushed furthest moves its joint, and no other does until it is back at its centre.
    """

    def __init__(self, deadman: int, axes: Mapping[str, Axis]):
        self._deadman, self._axes = deadman, axes
        self._armed = False
        self._demand: Demand | None = None
        self._received = -math.inf
        self.problem = ""  # why it is not followed

    def received(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> None:
        """Take a message that came at `now`."""
        if now - self._received > SILENCE:
            self._release("")
        self._received = now
        if problem := self._wrong(axes, buttons):
            self._release(problem)
            return
        if not buttons[self._deadman]:
            self._release("deadman button released")
            return
        pushed = {joint: axis.sign * axes[axis.number] for joint, axis in self._axes.items()}
        moved = {joint: value for joint, value in pushed.items() if abs(value) > CENTRE}
        if not self._armed:
            self._armed = not moved
            self.problem = "" if self._armed else "bring all axes to their centres first"
            return
        if not moved:
            self._demand = None
            return
        joint = max(moved, key=lambda one: abs(moved[one]))
        if self._demand and self._demand.joint in moved:
            joint = self._demand.joint
        self._demand = Demand(joint, _level(moved[joint]))

    def demand(self, now: float) -> Demand | None:
        """What is held at `now`."""
        if now - self._received > SILENCE:
            self._release("no messages on /joy")
        return self._demand

    def _wrong(self, axes: Sequence[float], buttons: Sequence[int]) -> str:
        if self._deadman >= len(buttons):
            return f"no button {self._deadman} on /joy, it has {len(buttons)}, from 0"
        for joint, axis in self._axes.items():
            if axis.number >= len(axes):
                return f"no axis {axis.number} for {joint} on /joy, it has {len(axes)}, from 0"
            if not math.isfinite(axes[axis.number]):
                return f"axis {axis.number} of {joint} is {axes[axis.number]}"
        return ""

    def _release(self, problem: str) -> None:
        self._armed, self._demand, self.problem = False, None, problem


def _level(value: float) -> float:
    """0 at the edge of the centre, 1 at the end."""
    return math.copysign(min(1.0, (abs(value) - CENTRE) / (1.0 - CENTRE)), value)


# The terminal read key by key, and given back as it was.

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
