"""A log of lifts: what was picked up, when it went, and how heavy it was."""

from collections.abc import Sequence
from typing import NamedTuple

from crane_observer.scale.scale import ScaleCondition, Weighing
from crane_observer.scale.weighing import TipLoad

LIGHTEST = 5.0  # kg, below which nothing was lifted
SURE = 3.0  # standard deviations, by which a load is more than nothing
KEPT = 100  # weighings of a lift, before the unneeded are forgotten
HEADINGS = (
    "picked_up [s]", "released [s]", "moved [s]", "load [kg]", "std_dev [kg]", "centre [m]",
    "centre.std_dev [m]",
)  # fmt: skip
UNWEIGHED = (
    ScaleCondition.WAITING, ScaleCondition.PRESSURES_LOST, ScaleCondition.POSITIONS_LOST,
    ScaleCondition.UNOBSERVABLE,
)  # fmt: skip


class Lift(NamedTuple):
    """One load from its pick-up to its release, or to the end of what was heard."""

    picked_up: float  # s; of the first weighing, where it hung there from the beginning
    released: float  # s
    moved: float  # s of motion in which it was weighed
    load: TipLoad  # as it was known best


def lifts(weighings: Sequence[Weighing]) -> list[Lift]:
    """Those among weighings in their order."""
    parts: list[list[Weighing]] = [[]]
    for one in weighings:
        if one.changed and parts[-1]:
            parts.append([])
        parts[-1].append(one)
    found = (lift_of(part, weighings[0].time) for part in parts if part)
    return [one for one in found if one is not None]


def lift_of(part: Sequence[Weighing], first: float) -> Lift | None:
    """What hung there in weighings between two changes, if anything did; `first` [s]: when it was
    weighed at all for the first time.
    """
    told = [one for one in part if one.condition not in UNWEIGHED]
    if not told:
        return None
    best = min(told, key=lambda one: one.load.deviation)
    if best.load.mass <= max(LIGHTEST, SURE * best.load.deviation):
        return None
    return Lift(max(best.since, first), part[-1].time, max(one.moved for one in told), best.load)


def row_of(lift: Lift, zero: float = 0.0) -> list[str]:
    """Cells below `HEADINGS`; times since `zero` [s] before those of the lift."""
    times = (f"{zero + one:.3f}" for one in (lift.picked_up, lift.released))
    return [*times, *(f"{value:.6g}" for value in (lift.moved, *lift.load))]


class LiftLog:
    """Lifts as they end, from weighings as they come; it remembers the best of each alone."""

    def __init__(self) -> None:
        self._first: float | None = None
        self._part: list[Weighing] = []

    def add(self, one: Weighing) -> Lift | None:
        """The lift that has ended by this weighing."""
        if self._first is None:
            self._first = one.time
        ended = None
        if one.changed:
            ended = lift_of(self._part, self._first)
            self._part = []
        self._part.append(one)
        if len(self._part) > KEPT:
            self._part = self._shortened(self._part)
        return ended

    def end(self) -> Lift | None:
        """The lift that hangs there still."""
        return lift_of(self._part, self._first or 0.0)

    def _shortened(self, part: list[Weighing]) -> list[Weighing]:
        """What `lift_of` looks at: the best, the longest moved and the last."""
        told = [one for one in part if one.condition not in UNWEIGHED]
        if not told:
            return part[-1:]
        best = min(told, key=lambda one: one.load.deviation)
        moved = max(told, key=lambda one: one.moved)
        return [best, moved, part[-1]]
