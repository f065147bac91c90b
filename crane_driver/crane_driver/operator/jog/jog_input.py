"""Keyboard and joystick of jog, and the valve commands that follow from them."""

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
from typing import NamedTuple, Self

from crane_driver import constants
from crane_model.errors import ConfigurationError, CraneError

JOINT_KEYS = (
    *(("h", "l"), ("j", "k"), ("u", "i"), ("n", "m")),
    *(("f", "g"), ("c", "v"), ("a", "s"), ("t", "y")),
)
"""Keys of the joints from the base to the tip: down, up. Further joints have a joystick alone."""
SPEED_KEYS = "123456789"
FIRST_SPEED = 3
STOP_KEY = "x"


LARGEST_READ_BYTES = 4096  # bytes read at once
IFLAG, CC = 0, 6  # places in what tcgetattr gives


class Demand(NamedTuple):
    """Motion that the operator asks for."""

    joint: str
    level: float  # -1 to 1, of the fastest


class CommandShape(NamedTuple):
    """How demands become valve commands."""

    maximum: float  # valve command at level 1
    dead_band: Mapping[str, float]  # joint: valve command that does not move it yet
    rise_time: float  # s, from neutral to level 1
    fall_time: float  # s, back


class JogMotion:
    """Valve commands from demands. All times are of the steady clock [s].

    A demand counts only after a moment without one: what is held when it begins, or after a pause,
    has to be let go first. A joint that is commanded reaches neutral before another one, or the
    other direction, begins.
    """

    def __init__(self, shape: CommandShape):
        """`ConfigurationError` where a dead band leaves no room below the maximum."""
        for joint, dead_band in shape.dead_band.items():
            if dead_band >= shape.maximum:
                raise ConfigurationError(
                    f"parameter 'dead_band.{joint}': must be less than 'maximum', "
                    f"{shape.maximum:g}, got {dead_band:g}"
                )
        self._shape = shape
        self._joint, self._level = next(iter(shape.dead_band)), 0.0
        self._stepped = -math.inf
        self._let_go = False

    @property
    def neutral(self) -> bool:
        return self._level == 0.0

    def step(self, demand: Demand | None, now: float) -> dict[str, float]:
        """The commands (-1 to 1) of all joints at `now`, while `demand` is held."""
        dt, self._stepped = now - self._stepped, now
        if dt > constants.LONGEST_PAUSE_S:  # everything begins at neutral again
            self._level, self._let_go = 0.0, False
        if demand is None:
            self._let_go = True
        else:
            demand = demand if self._let_go else None
        self._approach(demand, dt)
        commands = dict.fromkeys(self._shape.dead_band, 0.0)
        if self._level:
            shape, dead_band = self._shape, self._shape.dead_band[self._joint]
            size = dead_band + abs(self._level) * (shape.maximum - dead_band)
            commands[self._joint] = math.copysign(size, self._level)
        return commands

    def _approach(self, demand: Demand | None, dt: float) -> None:
        if self._level == 0.0 and demand:
            self._joint = demand.joint
        wanted = demand.level if demand and demand.joint == self._joint else 0.0
        level = self._level
        if (level * wanted > 0.0 and abs(wanted) > abs(level)) or level == 0.0:
            step = dt / self._shape.rise_time
        else:
            step = dt / self._shape.fall_time
            if level * wanted < 0.0:
                wanted = 0.0
        self._level = min(wanted, level + step) if wanted > level else max(wanted, level - step)


class Request(StrEnum):
    """Services of the driver that a key may call, by name."""

    ENABLE = "enable"
    DISABLE = "disable"
    RESET = "reset_fault"
    EMERGENCY_STOP = "emergency_stop"
    QUIT = "quit"


REQUESTS = {
    "e": Request.ENABLE,
    "d": Request.DISABLE,
    "r": Request.RESET,
    STOP_KEY: Request.EMERGENCY_STOP,
    "q": Request.QUIT,
}
CONTROLS = {str(request): key for key, request in REQUESTS.items()}


class Keyboard:
    """Each character of a joint's key holds the joint for `hold` seconds (steady clock).

    A terminal tells of keys that go down, never of keys let go. So a tap is a nudge of
    that length. A key that is held moves the joint so long, then the joint waits for the first
    repeat of the terminal, and goes on while repeats come. Every other key, and what comes at once
    with other characters, such as pasted text, lets the joint go.
    """

    def __init__(self, hold: float, joints: Sequence[str]):
        self._hold = hold
        self.pairs = dict(zip(joints, JOINT_KEYS, strict=False))
        self._keys = {
            key: (joint, direction)
            for joint, pair in self.pairs.items()
            for key, direction in zip(pair, (-1, 1), strict=True)
        }
        self._joint, self._direction = "", 0
        self._until = -math.inf
        self.step = FIRST_SPEED  # tenths of the fastest

    def typed(self, text: str, now: float) -> Request | None:
        if not text:
            return None
        self._until = -math.inf
        if STOP_KEY in text:  # even within what an arrow or Alt sends: one too many harms nobody
            return Request.EMERGENCY_STOP
        (key, *others) = set(text)
        if others:
            return None
        if key in self._keys:
            self._joint, self._direction = self._keys[key]
            self._until = now + self._hold
        elif key in SPEED_KEYS:
            self.step = int(key)
        return REQUESTS.get(key)

    def demand(self, now: float) -> Demand | None:
        if now >= self._until:
            return None
        return Demand(self._joint, self._direction * self.step / 10)


class Axis(NamedTuple):
    """Index of a joint's axis in a message, and its positive direction."""

    number: int
    sign: int


class Joystick:
    """All times are of the steady clock [s].

    The deadman button counts once all axes have been at their centres while it was held; letting it
    go, silence for more than `JOYSTICK_SILENCE_S` and an axis that is not finite let the joint
    go. The axis that is pushed furthest moves its joint, and no other does until it is back at its
    centre.
    """

    def __init__(self, deadman: int, axes: Mapping[str, Axis]):
        self._deadman, self._axes = deadman, axes
        self._armed = False
        self._demand: Demand | None = None
        self._received = -math.inf
        self.problem = ""  # why it is not followed

    def received(self, axes: Sequence[float], buttons: Sequence[int], now: float) -> None:
        if now - self._received > constants.JOYSTICK_SILENCE_S:
            self._release("")
        self._received = now
        if problem := self._wrong(axes, buttons):
            self._release(problem)
            return
        if not buttons[self._deadman]:
            self._release("deadman button released")
            return
        pushed = {joint: axis.sign * axes[axis.number] for joint, axis in self._axes.items()}
        moved = {
            joint: value for joint, value in pushed.items() if abs(value) > constants.CENTRE_SHARE
        }
        if not self._armed:
            self._armed = not moved
            self.problem = "" if self._armed else "bring all axes to their centres first"
            return
        if not moved:
            self._demand = None
            return
        joint = max(moved, key=lambda joint: abs(moved[joint]))
        if self._demand and self._demand.joint in moved:
            joint = self._demand.joint
        self._demand = Demand(joint, _level(moved[joint]))

    def demand(self, now: float) -> Demand | None:
        if now - self._received > constants.JOYSTICK_SILENCE_S:
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
    return math.copysign(
        min(1.0, (abs(value) - constants.CENTRE_SHARE) / (1.0 - constants.CENTRE_SHARE)), value
    )


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
                "keys are read from a terminal, but standard input is not a terminal; start jog "
                "by itself in a terminal, or jog with a joystick: --joy"
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

    def __exit__(self, *_: object) -> None:
        # keys typed ahead were not meant for the shell
        with suppress(termios.error):  # the terminal has gone
            termios.tcsetattr(self._input, termios.TCSAFLUSH, self._before)

    def read(self, seconds: float) -> str:
        ready, _, _ = select.select([self._input], [], [], max(0.0, seconds))
        if not ready:
            return ""
        try:
            data = os.read(self._input, LARGEST_READ_BYTES)
        except OSError:  # hung up
            data = b""
        self.closed = not data
        return data.decode(errors="replace")


class NoTerminal:
    """In the place of a terminal where a joystick does without."""

    closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def read(self, seconds: float) -> str:
        time.sleep(max(0.0, seconds))
        return ""
