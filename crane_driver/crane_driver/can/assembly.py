"""Readings that several frames of one cycle bring, put together without mixing cycles."""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from crane_driver.can.cycles import WAITING, CycleNumbers
from crane_driver.can.decoder import Readings
from crane_driver.can.layout import Layout
from crane_driver.can.sampling import SamplingClock


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

    Frames belong together by their counters, however late a frame is received. Until the counters
    are known, or where the mapping names none, they belong together if they were received within
    half a cycle.

    Numbered cycles are stamped with the instant at which they were sampled (see `SamplingClock`),
    others with the reception of their first frame.
    """

    def __init__(self, layout: Layout, kind: Literal["positions", "pressures"]):
        carriers = [one for one in layout.readings if getattr(one, kind)]
        self._kind = kind
        self._messages = frozenset(one.name for one in carriers)
        self._cycle = min((one.cycle for one in carriers), default=0.0)
        self._clock = SamplingClock(self._cycle)
        self._unknown = dict.fromkeys(getattr(layout, kind), math.nan)
        self._numbers = (
            CycleNumbers(carriers, layout.timing) if CycleNumbers.possible(carriers) else None
        )
        self._by_counter = False
        self._open: dict[int, _Set] = {}  # by number of the cycle, in order of arrival
        self._done = -1  # number of the last complete cycle
        self.incomplete = 0  # cycles given up because one of their frames did not come

    def add(self, readings: Readings) -> Complete | None:
        """The cycle that this frame completes; None while others are to come."""
        if readings.message not in self._messages:
            return None
        number = self._numbers.number(readings) if self._numbers else None
        if self._by_counter is not (number is not None):  # from here on the numbers are others
            self._by_counter = number is not None
            self._give_up(list(self._open))
            self._clock = SamplingClock(self._cycle)
            self._done = -1 if number is None else number - 1
        if number is None:
            number = self._number_by_time(readings)
        return self._add(number, readings)

    def _number_by_time(self, readings: Readings) -> int:
        """That of the open set, unless the frame cannot be of it."""
        if not self._open:
            return self._done + 1
        ((number, open_set),) = self._open.items()
        late = readings.steady - open_set.steady > self._cycle / 2
        if not late and readings.message not in open_set.arrived:
            return number
        self._give_up([number])
        return number + 1

    def _add(self, number: int, readings: Readings) -> Complete | None:
        if number <= self._done:  # a later cycle was complete before
            return None
        one = self._open.get(number)
        if one and readings.steady - one.steady > WAITING * self._cycle:
            self._give_up([number])  # a round of the counter ago
            one = None
        if one is None:
            one = _Set(readings.stamp, readings.steady, dict(self._unknown))
            self._open[number] = one
            self._give_up([old for old in self._open if old <= number - WAITING])
        elif readings.message in one.arrived:
            return None  # repeated
        one.arrived.add(readings.message)
        one.values.update(getattr(readings, self._kind))
        if len(one.arrived) < len(self._messages):
            return None
        del self._open[number]
        self._give_up([old for old in self._open if old < number])
        self._done = number
        if self._numbers and not self._by_counter:
            self._numbers.learn()
        sampled = self._clock.sampled(number, one.steady) if self._by_counter else one.steady
        return Complete(
            one.stamp - round((one.steady - sampled) * 1e9), sampled, one.steady, one.values
        )

    def _give_up(self, numbers: list[int]) -> None:
        for number in numbers:
            del self._open[number]
        self.incomplete += len(numbers)
