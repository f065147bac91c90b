"""A log of lifts: what was picked up, when it went, and how heavy it was."""

from collections.abc import Sequence
from typing import NamedTuple

from crane_observer.scale.scale import ScaleCondition, Weighing
from crane_observer.scale.weighing import TipLoad

LIGHTEST = 5.0  # kg, below which nothing was lifted
SURE = 3.0  # standard deviations, by which a load is more than nothing
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
    found: list[Lift] = []
    parts: list[list[Weighing]] = [[]]
    for one in weighings:
        if one.changed and parts[-1]:
            parts.append([])
        parts[-1].append(one)
    for part in parts:
        told = [one for one in part if one.condition not in UNWEIGHED]
        if not told:
            continue
        best = min(told, key=lambda one: one.load.deviation)
        if best.load.mass > max(LIGHTEST, SURE * best.load.deviation):
            begin = max(best.since, weighings[0].time)
            found.append(Lift(begin, part[-1].time, max(one.moved for one in told), best.load))
    return found
