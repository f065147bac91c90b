"""Matching of two streams by time stamp: pressures interpolated to the stamps of the encoders.

Where forces are measured, they take the place of the pressures.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from crane_bags.fields import Place
from crane_identification.data.column_map import Source

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


# Quantities that stand in messages of several topics, brought together by their stamps.


class Gathered(NamedTuple):
    """One number of each source [SI] at `stamp` [ns]."""

    stamp: int
    values: np.ndarray  # (s,)


class Gathering:
    """Numbers of `sources` out of messages, at the stamps of the first topic that they name.

    Those of the other topics are interpolated to them, where their messages are at most
    `largest_gap` [ns] apart; what comes out depends on stamps alone.
    """

    def __init__(self, sources: Sequence[Source], largest_gap: int):
        readings = [(i, one) for i, source in enumerate(sources) for one in source.readings]
        self.topics = tuple(dict.fromkeys(one.stream for _, one in readings))
        by_topic = [[pair for pair in readings if pair[1].stream == t] for t in self.topics]
        self._readings = [[(one, Place(*one.cell)) for _, one in pairs] for pairs in by_topic]
        self._adds_to = np.array([i for pairs in by_topic for i, _ in pairs])
        self._count = len(sources)
        # each joins one more topic to those before it
        self._stages = [Matcher(largest_gap) for _ in self.topics[1:]]

    def add(self, topic: str, stamp: int, message: Any) -> list[Gathered]:
        """What a message of one of the topics completes; `ValueError` if a field is missing."""
        place = self.topics.index(topic)
        numbers = np.array(
            [float(one.in_si(np.array(at.number(message)))) for one, at in self._readings[place]]
        )
        if place == 0:
            complete = [(stamp, numbers)]
        else:
            stage = self._stages[place - 1]
            complete = [
                (one.stamp, np.concatenate(one[1:])) for one in stage.add_pressure(stamp, numbers)
            ]
        for stage in self._stages[place:]:
            complete = [
                (matched.stamp, np.concatenate(matched[1:]))
                for at, values in complete
                for matched in stage.add_position(at, values)
            ]
        return [
            Gathered(at, np.bincount(self._adds_to, values, self._count)) for at, values in complete
        ]
