"""Stalls of the driver itself, told from a machine that is silent."""

import math

from crane_driver.faults import Fault, FaultKind
from crane_nodes.scheduling import ProcessorTime

# Which remedy fits where it is not the want of priority, which the kind of the fault names.
IN_REAL_TIME = (
    "it has real-time priority: let all that has it use at most half of the cores, as "
    "docs/how_to/real_time.md says, or take a faster computer"
)
STOPPED = "it was stopped: look for a debugger, a suspended computer, or a disk that it waited for"


class StallWatch:
    """Judges by the steady clock how long the loop of the driver did not run."""

    def __init__(self, limit: float):
        """`limit` [s]: a longer pause is a stall."""
        self._limit = limit
        self._ran, self._spent = math.nan, ProcessorTime(math.nan)

    def ran(self, now: float, spent: ProcessorTime) -> Fault | None:
        """Return the stall that ends when the loop runs at `now` [s], with the time `spent` so far.

        The first run has nothing to be late by.
        """
        pause, before = now - self._ran, self._spent
        self._ran, self._spent = now, spent
        if not pause > self._limit:
            return None
        computed, waited = spent.computed - before.computed, spent.waited - before.waited
        kind, advice = FaultKind.STALLED, ""
        if computed > pause / 2:
            kind = FaultKind.OVERWORKED
        elif waited < pause / 2:
            advice = STOPPED
        elif spent.priority:
            advice = IN_REAL_TIME
        said = (
            f"{kind.cause}: after {pause * 1e3:.0f} ms, limit {self._limit * 1e3:.0f} ms; it "
            f"computed for {computed * 1e3:.0f} ms"
        )
        if math.isfinite(waited):
            said += f" and waited for a processor for {waited * 1e3:.0f} ms"
        return Fault(kind, said, advice=advice)


def behind(now: float, heard: float) -> Fault:
    """That frames wait at `now` [s] that came after `heard`, though the loop runs."""
    kind = FaultKind.STALLED
    return Fault(kind, f"{kind.cause}: it is {(now - heard) * 1e3:.0f} ms behind the bus")
