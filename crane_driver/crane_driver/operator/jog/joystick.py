"""What a joystick asks for: only while its deadman button is held."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from crane_driver.operator.jog.motion import Demand

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
