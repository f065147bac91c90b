"""How each fault moves the residuals: the parity signatures that tell sensors apart.

The position is in what either chamber is compared with: an encoder moves both residuals of its
joint alike, whatever the pressures are. A transducer moves that of its own chamber, by the flow
that its pressure makes and by the oil that a jump of it seems to compress; that of the supply moves
the chamber that is fed, of all joints, and what the supply itself should be. A valve does not do
what it is told: both chambers are fed less, and the supply droops less.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_observer.monitor.blocks import FlowBlock

SUPPLY = "supply"
COVERED = 1.96  # standard deviations to either side, of 95 %


class Wrong(StrEnum):
    """What is wrong."""

    STUCK = "stuck"
    JUMP = "jump"
    DRIFT = "drift"
    SCALE = "scale"
    NOISE = "noise"
    BACKLASH = "backlash"
    ERRATIC = "erratic"
    OFFSET = "offset"
    GAIN = "gain"
    SWAPPED = "swapped"
    SLOW = "slow"
    LEAKING = "leaking"
    OPEN = "open"


class Part(StrEnum):
    """What a fault is in."""

    ENCODER = "encoder"
    PRESSURE_A = "pressure A"
    PRESSURE_B = "pressure B"
    PRESSURES = "pressures A and B"
    SUPPLY = "supply pressure"
    VALVE = "valve"


@dataclass(frozen=True)
class FaultSpan:
    """n blocks of j joints, as arrays, from when a fault may have begun."""

    duration: Array  # (n,) s
    since: Array  # (n,) s since it began, at the ends of the blocks
    encoder: Array  # (n, j)
    flow: Array  # (n, j, 2)
    crossed: Array
    fed: Array
    drop: Array
    softness: Array
    leak: Array
    known: Array  # (n, j, 2)
    pressure: Array  # (n, j, 2)
    last: Array
    stroke: Array  # (n, j)
    lever: Array
    feeding: Array  # (n,)

    @classmethod
    def of(cls, blocks: Sequence[FlowBlock]) -> "FaultSpan":
        """Of blocks in their order."""

        def stacked(name: str) -> Array:
            return np.array([getattr(block, name) for block in blocks])

        shared = [field.name for field in fields(cls)][2:]
        begin = stacked("begin")
        return cls(
            stacked("time") - begin,
            stacked("time") - begin[0],
            **{name: stacked(name) for name in shared},
        )

    def went(self, j: int) -> Array:
        """(n,) m that piston j went, by the chambers of which it is known."""
        weight = np.where(self.known[:, j].any(axis=1, keepdims=True), self.known[:, j], True)
        return np.asarray((weight * self.flow[:, j]).sum(axis=1) / weight.sum(axis=1))


class Signature(NamedTuple):
    """What a fault of a part adds to residuals, for a size of 1.

    `moves` gives (n, 2) of the joint, and (n,) of the supply. Of a `whole` fault they are those of
    the size that it says.
    """

    part: Part
    kind: Wrong
    unit: str
    moves: Callable[[FaultSpan, int], tuple[Array, Array]]
    whole: float | None = None


def _nothing(course: FaultSpan) -> Array:
    return np.zeros(len(course.since))


def _alike(
    values: Callable[[FaultSpan, int], Array],
) -> Callable[[FaultSpan, int], tuple[Array, Array]]:
    """Of an encoder: both chambers are compared with it."""

    def moves(course: FaultSpan, j: int) -> tuple[Array, Array]:
        return np.repeat(values(course, j)[:, None], 2, axis=1), _nothing(course)

    return moves


def _drifting(course: FaultSpan, j: int) -> Array:
    """m at the piston of an encoder that drifts by 1 m/s there, as it begins."""
    return course.duration * course.lever[:, j] / course.lever[0, j]


_erratic = _alike(lambda c, j: c.encoder[:, j] - c.went(j))
"""An encoder that shows what it likes."""


def _transducer(
    side: int, error: Callable[[FaultSpan, int], Array]
) -> Callable[..., tuple[Array, Array]]:
    """Of a chamber, `error` (n,) Pa at the ends of blocks: by its flow, and its compression."""

    def moves(course: FaultSpan, j: int) -> tuple[Array, Array]:
        shown = error(course, j)
        out = np.zeros((len(shown), 2))
        out[:, side] = course.drop[:, j, side] * shown
        out[:, side] += course.softness[:, j, side] * np.diff(shown, prepend=0.0)
        return out, _nothing(course)

    return moves


def _shown(side: int) -> Callable[[FaultSpan, int], Array]:
    """Pa that a transducer showed at the ends of blocks."""

    def values(course: FaultSpan, j: int) -> Array:
        return course.last[:, j, side]

    return values


def _exchanged(course: FaultSpan, j: int) -> tuple[Array, Array]:
    """Each chamber shows the pressure of the other."""
    return course.crossed[:, j] - course.flow[:, j], _nothing(course)


def _valve(
    values: Callable[[FaultSpan, int], Array],
) -> Callable[[FaultSpan, int], tuple[Array, Array]]:
    """Of a valve, (n, 2) m that the chambers are fed less than told."""

    def moves(course: FaultSpan, j: int) -> tuple[Array, Array]:
        less = values(course, j)
        slower = less.mean(axis=1) * np.sign(course.went(j)) / course.duration
        return -less, course.stroke[:, j] * slower

    return moves


def _lagging(lag: float) -> Callable[[FaultSpan, int], Array]:
    """m that a flow which follows by a first-order lag [s] lacks; settled when it begins."""

    def values(course: FaultSpan, j: int) -> Array:
        told = course.flow[:, j] / course.duration[:, None]
        shown, at = np.empty_like(told), told[0]
        for k, passed in enumerate(course.duration / lag):
            left = math.exp(-passed)
            shown[k] = told[k] + (1.0 - left) / passed * (at - told[k])  # in the mean of a block
            at = told[k] + left * (at - told[k])
        return np.asarray((told - shown) * course.duration[:, None])

    return values


def _free(course: FaultSpan, j: int) -> tuple[Array, Array]:
    """A spool that does what it likes: the encoder is right, and the supply droops by that."""
    moves, _ = _erratic(course, j)
    more = np.abs(course.encoder[:, j]) - np.abs(course.went(j))
    return moves, -course.stroke[:, j] * more / course.duration


def _passing(course: FaultSpan, j: int) -> tuple[Array, Array]:
    """A valve that passes oil whatever it is told: the piston goes, and the supply droops."""
    return np.repeat(course.duration[:, None], 2, axis=1), -course.stroke[:, j]


def _lost_motion(play: float) -> Callable[[FaultSpan, int], Array]:
    """m that an encoder behind a play shows less: it trails the motion by half of it."""

    def values(course: FaultSpan, j: int) -> Array:
        true = np.cumsum(course.went(j))
        shown, at = np.empty_like(true), 0.0
        for k, x in enumerate(true):
            at = min(x + 0.5 * play, max(x - 0.5 * play, at))
            shown[k] = at
        return np.diff(shown - true, prepend=0.0)

    return values


PLAYS = 2.5e-4 * 1.5 ** np.arange(9)  # m at the piston
LAGS = 0.015 * 1.5 ** np.arange(10)  # s


def signatures() -> Iterator[Signature]:
    """Of all faults that residuals tell, of two that tell as much the first; jumps of encoders are
    none of them, since readings tell those.
    """
    encoder, valve = Part.ENCODER, Part.VALVE
    yield Signature(encoder, Wrong.STUCK, "", _alike(lambda c, j: -c.went(j)), whole=1.0)
    yield Signature(encoder, Wrong.DRIFT, "m/s", _alike(_drifting))
    yield Signature(encoder, Wrong.SCALE, "1", _alike(lambda c, j: c.went(j)))
    for play in PLAYS:
        lost = _alike(_lost_motion(float(play)))
        yield Signature(encoder, Wrong.BACKLASH, "m", lost, whole=float(play))
    yield Signature(encoder, Wrong.ERRATIC, "", _erratic, whole=1.0)
    for side, part in enumerate((Part.PRESSURE_A, Part.PRESSURE_B)):
        yield Signature(
            part, Wrong.OFFSET, "Pa", _transducer(side, lambda c, _: np.ones_like(c.since))
        )
        yield Signature(part, Wrong.DRIFT, "Pa/s", _transducer(side, lambda c, _: c.since))
        yield Signature(part, Wrong.GAIN, "1", _transducer(side, _shown(side)))
    yield Signature(Part.PRESSURES, Wrong.SWAPPED, "", _exchanged, whole=1.0)
    yield Signature(valve, Wrong.STUCK, "", _free, whole=1.0)
    for lag in LAGS:
        yield Signature(valve, Wrong.SLOW, "s", _valve(_lagging(float(lag))), whole=float(lag))
    yield Signature(valve, Wrong.LEAKING, "m3/(s Pa)", lambda c, j: (c.leak[:, j], _nothing(c)))
    yield Signature(valve, Wrong.OPEN, "m/s", _passing)
