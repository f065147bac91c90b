"""Stalls of the driver itself, told from a machine that is silent."""

import math

REMEDY = (
    "give the driver real-time priority (realtime.priority) or take other work off this machine, "
    "then reset_fault"
)


class StallWatch:
    """Judges by the steady clock how long the loop of the driver did not run."""

    def __init__(self, limit: float):
        """`limit` [s]: a longer pause is a stall."""
        self._limit = limit
        self._ran = self._computed = math.nan

    def ran(self, now: float, computed: float) -> str:
        """What is wrong, in words, when the loop runs at `now` [s]; empty if nothing is.

        `computed`: processor time [s] that the whole process has used so far. The first run has
        nothing to be late by.
        """
        pause, used = now - self._ran, computed - self._computed
        self._ran, self._computed = now, computed
        if not pause > self._limit:
            return ""
        if used > pause / 2:
            return (
                f"its own work took {pause * 1e3:.0f} ms, limit {self._limit * 1e3:.0f} ms; too "
                "much comes at once, or this processor is too slow; then reset_fault"
            )
        return (
            f"it was not given the processor for {pause * 1e3:.0f} ms, limit "
            f"{self._limit * 1e3:.0f} ms; {REMEDY}"
        )


def behind(now: float, heard: float) -> str:
    """In words, that frames wait at `now` [s] that came after `heard`, though the loop runs."""
    return (
        f"it is {(now - heard) * 1e3:.0f} ms behind the bus: too many frames come (look at the "
        f"diagnostics of the bus), or {REMEDY}"
    )
