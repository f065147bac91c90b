"""Stalls of the driver itself, told from a machine that is silent."""

import math

from crane_driver.faults import Fault, FaultKind


class StallWatch:
    """Judges by the steady clock how long the loop of the driver did not run."""

    def __init__(self, limit: float):
        """`limit` [s]: a longer pause is a stall."""
        self._limit = limit
        self._ran = self._computed = math.nan

    def ran(self, now: float, computed: float) -> Fault | None:
        """What is wrong when the loop runs at `now` [s].

        `computed`: processor time [s] that the whole process has used so far. The first run has
        nothing to be late by.
        """
        pause, used = now - self._ran, computed - self._computed
        self._ran, self._computed = now, computed
        if not pause > self._limit:
            return None
        kind = FaultKind.OVERWORKED if used > pause / 2 else FaultKind.STALLED
        said = f"{kind.cause}: after {pause * 1e3:.0f} ms, limit {self._limit * 1e3:.0f} ms"
        return Fault(kind, said)


def behind(now: float, heard: float) -> Fault:
    """That frames wait at `now` [s] that came after `heard`, though the loop runs."""
    kind = FaultKind.STALLED
    return Fault(kind, f"{kind.cause}: it is {(now - heard) * 1e3:.0f} ms behind the bus")
