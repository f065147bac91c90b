"""Readings that several frames of one cycle bring, put together without mixing cycles."""

import math
from typing import Literal, NamedTuple

from crane_driver.can.decoder import Readings
from crane_driver.can.layout import Layout


class Complete(NamedTuple):
    """The readings of one cycle, received within half a cycle."""

    stamp: int  # ns, of the first of the frames: it is nearest to the sampling instant
    steady: float  # s, likewise
    values: dict[str, float]  # all names, in the layout's order; NaN where it is no measurement


class Assembly:
    """Collects the positions or the pressures of a layout from all frames that carry them."""

    def __init__(self, layout: Layout, kind: Literal["positions", "pressures"]):
        carriers = [one for one in layout.readings if getattr(one, kind)]
        self._kind = kind
        self._messages = frozenset(one.name for one in carriers)
        self._span = min((one.cycle for one in carriers), default=0.0) / 2
        self._unknown = dict.fromkeys(getattr(layout, kind), math.nan)
        self._arrived: set[str] = set()
        self._stamp, self._steady = 0, 0.0
        self._values: dict[str, float] = {}
        self.incomplete = 0  # cycles given up because one of their frames did not come

    def add(self, readings: Readings) -> Complete | None:
        """The cycle that this frame completes; None while others are to come."""
        message = readings.message
        if message not in self._messages:
            return None
        late = readings.steady - self._steady > self._span
        if self._arrived and (late or message in self._arrived):
            self.incomplete += 1
            self._arrived = set()
        if not self._arrived:
            self._stamp, self._steady = readings.stamp, readings.steady
            self._values = dict(self._unknown)
        self._arrived.add(message)
        self._values.update(getattr(readings, self._kind))
        if len(self._arrived) < len(self._messages):
            return None
        self._arrived = set()
        return Complete(self._stamp, self._steady, self._values)
