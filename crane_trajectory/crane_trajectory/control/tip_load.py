"""How far a load at the tip, as a scale tells it, is believed: what the crane is led with.

A load m that is told with a standard deviation s counts as

    m m^2 / (m^2 + s^2)

so that one which may as well be nothing counts as nothing. One that is old, is no number, comes
of a scale that is degraded, or is heavier than any that is allowed counts as nothing, too. The
crane is led with a mass that goes there at a bounded rate: whatever is told, no command jumps.
"""

import math
from typing import NamedTuple

RATE = 20.0  # kg/s
OLDEST = 1.0  # s between the load that is told and the reading that it is used with
LONGEST = 0.05  # s between two readings; a longer gap counts as this
BELIEVED = ("GOOD", "AT_REST", "UNOBSERVABLE")
"""Conditions of a scale that has its readings. Where a pose does not permit weighing, it keeps the
load, with a standard deviation that grows."""


class ToldLoad(NamedTuple):
    """What a scale tells."""

    time: float  # s, of the clock of the readings
    mass: float  # kg
    deviation: float  # kg, standard deviation
    condition: str


class FedLoad:
    """The mass that the crane is led with; `heaviest` [kg] is the largest that is believed."""

    def __init__(self, heaviest: float):
        self._heaviest = heaviest
        self._told: ToldLoad | None = None
        self._time = math.inf
        self.mass = 0.0  # kg

    def tell(self, told: ToldLoad) -> None:
        """The newest."""
        self._told = told

    def at(self, time: float) -> float:
        """The mass [kg] at a time [s], which moves towards what is believed then."""
        step = RATE * min(max(time - self._time, 0.0), LONGEST)
        self._time = time
        away = self.believed(time) - self.mass
        self.mass += min(max(away, -step), step)
        return self.mass

    def believed(self, time: float) -> float:
        """What is told [kg], as far as it counts at a time [s]."""
        told = self._told
        if told is None or told.condition not in BELIEVED:
            return 0.0
        if not abs(time - told.time) <= OLDEST:
            return 0.0
        if not (0.0 < told.mass <= self._heaviest and 0.0 <= told.deviation < math.inf):
            return 0.0
        share = told.mass / math.hypot(told.mass, told.deviation)
        return told.mass * share**2
