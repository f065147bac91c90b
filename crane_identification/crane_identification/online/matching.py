"""Matching of two streams by time stamp: pressures interpolated to the stamps of the encoders.

Where forces are measured, they take the place of the pressures.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

CAPACITY = 2000  # samples of each stream that may wait for the other one: 10 s at 200 Hz


class Matched(NamedTuple):
    """Positions (j,) as they were read at `stamp` [ns], pressures (c,) interpolated to it."""

    stamp: int
    position: np.ndarray
    pressure: np.ndarray


class Matcher:
    """Pairs positions with the pressures around them; what comes out depends on stamps alone.

    A position is unmatched if no pressure of its stamp exists and the two around it are further
    apart than `largest_gap` [ns], or if more than `CAPACITY` positions wait. A stream whose clock
    goes back by more than `largest_gap` starts anew; samples that are not newer than the last one
    of their stream are dropped as `repeated`.
    """

    def __init__(self, largest_gap: int):
        self._gap = largest_gap
        self._positions: deque[tuple[int, np.ndarray]] = deque()
        self._pressures: deque[tuple[int, np.ndarray]] = deque()
        self._newest_position: int | None = None
        self.matched = 0
        self.unmatched = 0
        self.repeated = 0

    def add_position(self, stamp: int, position: np.ndarray) -> list[Matched]:
        """A reading of all joints; returns what can be matched now, in the order of stamps."""
        newest, self._newest_position = self._newest_position, stamp
        if newest is not None and stamp <= newest:
            if newest - stamp <= self._gap:
                self._newest_position = newest
                self.repeated += 1
                return []
            self.unmatched += len(self._positions)
            self._positions.clear()
        self._positions.append((stamp, position))
        if len(self._positions) > CAPACITY:
            self._positions.popleft()
            self.unmatched += 1
        return self._match()

    def add_pressure(self, stamp: int, pressure: np.ndarray) -> list[Matched]:
        """Pressures read at the same time; returns what can be matched now."""
        if self._pressures and stamp <= self._pressures[-1][0]:
            if self._pressures[-1][0] - stamp <= self._gap:
                self.repeated += 1
                return []
            self._pressures.clear()
        self._pressures.append((stamp, pressure))
        if len(self._pressures) > CAPACITY:
            self._pressures.popleft()
        return self._match()

    def _match(self) -> list[Matched]:
        out = []
        positions, pressures = self._positions, self._pressures
        while positions and pressures and positions[0][0] <= pressures[-1][0]:
            stamp, position = positions.popleft()
            while len(pressures) > 1 and pressures[1][0] <= stamp:
                pressures.popleft()
            pressure = self._interpolated(stamp)
            if pressure is None:
                self.unmatched += 1
            else:
                self.matched += 1
                out.append(Matched(stamp, position, pressure))
        return out

    def _interpolated(self, stamp: int) -> np.ndarray | None:
        """Pressures at `stamp`, between the first two that are kept; None if there are none."""
        before, earlier = self._pressures[0]
        if before == stamp:
            return earlier
        if before > stamp:
            return None
        after, later = self._pressures[1]
        if after - before > self._gap:
            return None
        return earlier + (stamp - before) / (after - before) * (later - earlier)
