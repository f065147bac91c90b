"""The interface of all controllers: a state in, a command out; without ROS and without a clock."""

from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np

# What every controller takes and gives: a state in, a command out; no ROS and no clock.


class SensorReading(NamedTuple):
    """What the sensors of j joints show, (j,) each [SI]; NaN where nothing is measured."""

    position: np.ndarray  # rad, m
    velocity: np.ndarray  # rad/s, m/s
    pressure_a: np.ndarray  # Pa
    pressure_b: np.ndarray  # Pa
    supply: float  # Pa


class ChamberPressures(NamedTuple):
    """What transducers show of j joints [Pa]; NaN where nothing is measured."""

    a: np.ndarray  # (j,)
    b: np.ndarray
    supply: float

    @classmethod
    def none(cls, count: int) -> "ChamberPressures":
        """Nothing is measured of `count` joints."""
        nothing = np.full(count, np.nan)
        return cls(nothing, nothing, np.nan)


class Point(NamedTuple):
    """The reference of j joints at one instant, (j,) each [SI]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Wanted(NamedTuple):
    """The reference now, and `Controller.preview` later, as far as the reference knows."""

    now: Point
    ahead: Point
    phase: float = np.nan  # s since the period of a periodic motion began; NaN outside of one
    largest: float = 1.0  # command that is allowed: beyond it a controller is saturated


class ControlCondition(IntEnum):
    """How a joint, or a controller as its worst joint, is doing; the graver the larger."""

    AT_REST = 0
    FOLLOWING = 1
    ADAPTATION_AT_BOUND = 2
    PRESSURES_LOST = 3
    SATURATED = 4
    NOT_INITIALISED = 5
    NOT_MEASURED = 6
    NO_ANSWER = 7
    WRONG_MODEL = 8

    @property
    def text(self) -> str:
        """In words."""
        return WORDS[self]

    @property
    def stops(self) -> bool:
        """Whether the controller leads the command to zero and keeps it there until `start`."""
        return self >= ControlCondition.NOT_INITIALISED


WORDS = {
    ControlCondition.AT_REST: "at rest",
    ControlCondition.FOLLOWING: "following",
    ControlCondition.ADAPTATION_AT_BOUND: "adaptation at its bound: check valve and dead zones",
    ControlCondition.PRESSURES_LOST: "pressures lost: using the load of the model",
    ControlCondition.SATURATED: "saturated: lower the speed of the reference",
    ControlCondition.NOT_INITIALISED: "not initialised: valves closed",
    ControlCondition.NOT_MEASURED: "position not measured: valves closed",
    ControlCondition.NO_ANSWER: "valve does not answer: valves closed",
    ControlCondition.WRONG_MODEL: "wrong model, the joint moves against its command: valves closed",
}


CONDITIONS = tuple(ControlCondition)


def conditions(codes: np.ndarray) -> tuple[ControlCondition, ...]:
    """By their numbers (j,)."""
    return tuple([CONDITIONS[int(code)] for code in codes.tolist()])


class Controller(Protocol):
    """Commands the valves of j joints in the machine's order.

    `start` comes first; before it, and where `ControlCondition.stops`, the command goes to zero. A
    reading that is not finite moves nothing.
    """

    @property
    def preview(self) -> float:
        """How far ahead it wants the reference [s]: the lag of loop and valves."""

    @property
    def by_model(self) -> np.ndarray:
        """(j,) whether a joint is led by the model: it is kept nearer to the reference."""

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) -1..1 was in force, without a jump."""

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """Commands (j,) in -1..1 that answer a reading `dt` [s] after the last one."""

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Of each joint, after the last command."""


def in_words(conditions: tuple[ControlCondition, ...], joints: tuple[str, ...]) -> str:
    """The gravest condition and the joints that have it."""
    worst = max(conditions)
    if worst <= ControlCondition.FOLLOWING:
        return worst.text
    have_it = [joint for joint, one in zip(joints, conditions, strict=True) if one == worst]
    return f"{', '.join(have_it)}: {worst.text}"


# A controller around another one.


class WrappedController:
    """A controller that does all as the `inner` one does; what differs, another class overrides."""

    def __init__(self, inner: Controller):
        self.inner = inner

    @property
    def preview(self) -> float:
        """As the inner one has it [s]."""
        return self.inner.preview

    @property
    def by_model(self) -> np.ndarray:
        """As the inner one has it (j,)."""
        return self.inner.by_model

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """As the inner one has them."""
        return self.inner.conditions

    def start(self, command: np.ndarray) -> None:
        """As the inner one."""
        self.inner.start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As the inner one (j,)."""
        return self.inner.command(dt, reading, wanted)
