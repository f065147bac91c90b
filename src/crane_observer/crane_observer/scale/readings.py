"""The newest readings of some sensors, in the order of their stamps."""

import numpy as np

from crane_model.array import Array

HELD = 256  # readings: more than a window of the fastest sensors, at 400 Hz


class HeldReadings:
    """Of `width` sensors that are read together."""

    def __init__(self, width: int):
        self._time, self._values = np.empty(2 * HELD), np.empty((2 * HELD, width))
        self._count = 0
        self.late = 0  # readings that came after newer ones, and were left out
        self.invalid = 0  # readings with something that is no number

    @property
    def newest(self) -> float:
        """Stamp of the newest [s]; -inf before the first."""
        return float(self._time[self._count - 1]) if self._count else -np.inf

    @property
    def held(self) -> tuple[Array, Array]:
        """Stamps (n,) and values (n, width)."""
        return self._time[: self._count], self._values[: self._count]

    def add(self, time: float, values: Array) -> None:
        """One more, unless it is late."""
        if not np.isfinite(values).all():
            self.invalid += 1
        if not time > self.newest:
            self.late += 1
            return
        if self._count == len(self._time):
            self._time[:HELD] = self._time[HELD:]
            self._values[:HELD] = self._values[HELD:]
            self._count = HELD
        self._time[self._count], self._values[self._count] = time, values
        self._count += 1
