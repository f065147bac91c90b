"""Readings that several frames of one cycle bring, put together without mixing cycles."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from crane_driver.can.cycles import CycleNumbers, Placed
from crane_driver.can.decoder import Readings
from crane_driver.can.layout import Layout
from crane_driver.can.sampling import SamplingClock

LONGEST_WAIT_CYCLES = 20  # cycles for which a frame is waited for
CLOCK_SET = 1_000_000_000  # ns; the wall clock was set if it goes back by more


class Complete(NamedTuple):
    """The readings of one cycle."""

    stamp: int  # ns since the epoch, of the sampling
    sampled: float  # s, steady, likewise
    received: float  # s, steady, of the first of the frames
    values: dict[str, float]  # all names, in the layout's order; NaN where it is no measurement


@dataclass(slots=True)
class _Set:
    """What has come of one cycle."""

    stamp: int
    steady: float
    values: dict[str, float]
    arrived: set[str] = field(default_factory=set)


class Assembly:
    """Collects the positions or the pressures of a layout from all frames that carry them.

    Frames belong together by their counters, however late a frame is received. Until it is known
    which counters belong together, frames wait. Where the mapping names no counters, frames belong
    together if they were received within half a cycle.

    Numbered cycles are stamped with the instant at which they were sampled (see `SamplingClock`),
    others with the reception of their first frame. Stamps increase.
    """

    def __init__(self, layout: Layout, kind: Literal["positions", "pressures"]):
        carriers = [one for one in layout.readings if getattr(one, kind)]
        self._kind = kind
        self._messages = frozenset(one.name for one in carriers)
        self._cycle = min((one.cycle for one in carriers), default=0.0)
        self._unknown = dict.fromkeys(getattr(layout, kind), math.nan)
        self._numbers = (
            CycleNumbers(carriers, layout.timing) if CycleNumbers.possible(carriers) else None
        )
        self._epoch = 0
        self._clock = SamplingClock(self._cycle)
        self._open: dict[int, _Set] = {}  # by number of the cycle, in order of arrival
        self._done: int | None = -1 if self._numbers is None else None  # the last complete cycle
        self._last = Complete(0, -math.inf, -math.inf, {})
        self._given_up = 0

    @property
    def incomplete(self) -> int:
        """Cycles given up: a frame is missing, came too late, or may be of another cycle."""
        dropped = self._numbers.dropped.values() if self._numbers else ()
        return self._given_up + max(dropped, default=0)

    def add(self, readings: Readings) -> list[Complete]:
        """The cycles that this frame completes, oldest first; none while others are to come."""
        if readings.message not in self._messages:
            return []
        if self._numbers is None:
            complete = self._add(self._number_by_time(readings), readings)
            return [complete] if complete else []
        return self._numbered(self._numbers.place(readings))

    def finish(self) -> list[Complete]:
        """The cycles of frames that still wait for numbers: no more come."""
        return self._numbered(self._numbers.settle()) if self._numbers else []

    def _numbered(self, placed: Iterable[Placed]) -> list[Complete]:
        """The cycles that frames with a number complete."""
        complete = []
        for one in placed:
            if one.epoch != self._epoch or self._done is None:
                self._begin(one)
            complete.append(self._add(one.number, one.readings, one.proven))
        return [one for one in complete if one]

    def _begin(self, first: Placed) -> None:
        """Numbers begin anew; what has come so far stays in pieces."""
        self._give_up(list(self._open))
        self._epoch, self._done = first.epoch, first.number - LONGEST_WAIT_CYCLES
        self._clock = SamplingClock(self._cycle)

    def _number_by_time(self, readings: Readings) -> int:
        """That of the open set, unless the frame cannot be of it."""
        assert self._done is not None
        if not self._open:
            return self._done + 1
        ((number, open_set),) = self._open.items()
        late = readings.steady - open_set.steady > self._cycle / 2
        if not late and readings.message not in open_set.arrived:
            return number
        self._give_up([number])
        return number + 1

    def _add(self, number: int, readings: Readings, proven: bool = True) -> Complete | None:
        assert self._done is not None
        if number <= self._done:  # a later cycle was complete before
            return None
        one = self._open.get(number)
        if one is None:
            one = _Set(readings.stamp, readings.steady, dict(self._unknown))
            self._open[number] = one
            self._give_up([old for old in self._open if old <= number - LONGEST_WAIT_CYCLES])
        elif readings.message in one.arrived:
            return None  # repeated
        if not proven:  # counted, if no other completes it
            return None
        if not one.arrived:
            one.stamp, one.steady = readings.stamp, readings.steady
        one.arrived.add(readings.message)
        one.values.update(getattr(readings, self._kind))
        if len(one.arrived) < len(self._messages):
            return None
        del self._open[number]
        self._give_up([old for old in self._open if old < number])
        self._done = number
        return self._stamped(number, one)

    def _stamped(self, number: int, one: _Set) -> Complete | None:
        """None, and given up, if it was not sampled after the last one: a clock is wrong."""
        sampled = self._clock.sampled(number, one.steady) if self._numbers else one.steady
        stamp = one.stamp - round((one.steady - sampled) * 1e9)
        back = self._last.stamp - stamp  # ns
        if sampled <= self._last.sampled or 0 <= back < CLOCK_SET:
            self._given_up += 1
            return None
        self._last = Complete(stamp, sampled, one.steady, one.values)
        return self._last

    def _give_up(self, numbers: list[int]) -> None:
        for number in numbers:
            del self._open[number]
        self._given_up += len(numbers)
