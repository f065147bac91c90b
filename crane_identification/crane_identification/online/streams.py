"""Streams of live readings: matched by their stamps, and smoothed with a fixed lag."""

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from crane_bags.clocks import NANOSECONDS
from crane_bags.fields import Place
from crane_identification.data.column_map import Source

# Fixed-lag smoothing of the motion, and the same linear operator on the forces.
#
# The operator S convolves the linear interpolation of the readings with the kernel
#
#     s(t) = 315/512 (3 - 11 u²) (1 - u²)³ / lag,  u = t/lag,  |u| < 1.
#
# Its derivatives are exact: (Sq)' and (Sq)'' are the convolutions with s' and s''. S leaves
# polynomials up to degree 3 as they are, which makes φ(Sq) equal to Sφ(q) up to the fourth order of
# lag, and passes motion up to 0.78/lag (-3 dB). So lag has to be short beside everything the crane
# does, its swinging on the oil included; rows are made of many instants (see `window`).
#
# Why no fixed-lag Kalman smoother: its velocity is no derivative of its position while the gains
# settle, it never quite forgets a bad reading, and its gains would follow every jitter of the
# stamps for each joint. S knows nothing that is older than two lags.
#
# Convolving a piecewise linear signal leaves divided differences of the kernel's integrals at the
# stamps as weights of the readings, whatever the stamps: straight lines stay exact under any
# jitter, and constants leave no trace in the derivatives.

SHORTEST_INTERVAL = 250_000  # ns; readings closer together than this are the same
CAPACITY = 2000  # samples of each stream that may wait for the other one: 10 s at 200 Hz


class Smoothed(NamedTuple):
    """Output of S at one instant `stamp` [ns] of the uninterrupted stretch number `run`.

    `position`, `velocity`, `acceleration` (j,) in rad or m, per s, per s²; `carried` (c,) are the
    other signals; `velocity_gain` [1/s] is the standard deviation of the velocity per unit standard
    deviation of a single reading, if their errors are independent.
    """

    stamp: int
    run: int
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    carried: np.ndarray
    velocity_gain: float


class FixedLagSmoother:
    """S at every multiple of `period` [s] of the clock, `lag` [s] behind the newest reading.

    Instants lie on the grid of the clock, not on readings, so that they do not depend on which
    reading came first. A time without readings longer than `largest_gap` [s], or a clock that goes
    back by more, begins a new run; a reading that is not newer than the last one is not used.
    """

    def __init__(self, joints: int, lag: float, period: float, largest_gap: float):
        if not 0.0 < largest_gap <= 0.5 * lag:
            raise ValueError("largest_gap must be at most half the lag: readings on either side")
        self._joints = joints
        self._lag, self._period, self._gap = (
            round(seconds * NANOSECONDS) for seconds in (lag, period, largest_gap)
        )
        capacity = 4 * (self._lag // SHORTEST_INTERVAL + 2)
        self._stamps = np.zeros(capacity, dtype=np.int64)
        self._values = np.zeros((capacity, 0))
        self._begin = self._end = 0
        self._next = 0
        self.run = -1
        self.repeated = 0  # readings that were not used because they were not new

    def add(self, stamp: int, position: np.ndarray, carried: np.ndarray) -> list[Smoothed]:
        """The instants that a reading of `position` (j,) and other signals (c,) completes."""
        if self.run < 0 or abs(stamp - self._stamps[self._end - 1]) > self._gap:
            self._restart(stamp, len(position) + len(carried))
        elif stamp < self._stamps[self._end - 1] + SHORTEST_INTERVAL:
            self.repeated += 1
            return []
        if self._end == len(self._stamps):
            self._compact()
        self._stamps[self._end] = stamp
        self._values[self._end, : self._joints] = position
        self._values[self._end, self._joints :] = carried
        self._end += 1
        complete = []
        while self._next + self._lag <= stamp:
            complete.append(self._at(self._next))
            self._next += self._period
        return complete

    def _at(self, instant: int) -> Smoothed:
        """S at `instant`; readings that no later instant needs are dropped."""
        live = self._stamps[self._begin : self._end]
        self._begin += int(np.searchsorted(live, instant - self._lag, side="right")) - 1
        kept = slice(self._begin, self._end)
        motion, carried, gain = _convolve(
            self._stamps[kept], self._values[kept], instant, float(self._lag), self._joints
        )
        return Smoothed(instant, self.run, motion[0], motion[1], motion[2], carried, gain)

    def _restart(self, stamp: int, signals: int) -> None:
        self.run += 1
        self._begin = self._end = 0
        if self._values.shape[1] != signals:
            self._values = np.zeros((len(self._stamps), signals))
        self._next = -(-(stamp + self._lag) // self._period) * self._period

    def _compact(self) -> None:
        count = self._end - self._begin
        self._stamps[:count] = self._stamps[self._begin : self._end].copy()
        self._values[:count] = self._values[self._begin : self._end].copy()
        self._begin, self._end = 0, count


@njit(cache=True)
def _kernel(u: float) -> tuple[float, float, float]:
    """s, its integral and the integral of that, at u = t/lag, for lag = 1; linear beyond ±1."""
    if u <= -1.0:
        return 0.0, 0.0, 0.0
    if u >= 1.0:
        return 0.0, 1.0, u
    v = u * u
    c = 315.0 / 512.0
    density = c * (3.0 - 11.0 * v) * (1.0 - v) ** 3
    step = 3.0 - v * (20.0 / 3.0 - v * (8.4 - v * (36.0 / 7.0 - v * 11.0 / 9.0)))
    ramp = 1.5 - v * (5.0 / 3.0 - v * (1.4 - v * (9.0 / 14.0 - v * 11.0 / 90.0)))
    return density, 0.5 + c * u * step, 63.0 / 1024.0 + 0.5 * u + c * v * ramp


@njit(cache=True)
def _convolve(
    stamps: np.ndarray, values: np.ndarray, instant: int, lag: float, joints: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """S and its two derivatives of the first `joints` columns, S of the others, velocity gain.

    The first stamp is at or before instant - lag, the last one at or after instant + lag.
    """
    n, columns = values.shape
    second = 1e-9 * lag
    motion, carried = np.zeros((3, joints)), np.zeros(columns - joints)
    squares = 0.0
    u = (instant - stamps[0]) / lag
    density, step, ramp = _kernel(u)
    # slopes of s, its integral and the integral of that, over the interval before each reading
    density_slope, step_slope, ramp_slope = 0.0, 0.0, 1.0
    for i in range(n):
        if i + 1 < n:
            u_next = (instant - stamps[i + 1]) / lag
            following = _kernel(u_next)
            h = u - u_next
            slopes = (
                (density - following[0]) / h,
                (step - following[1]) / h,
                (ramp - following[2]) / h,
            )
        else:
            u_next, following, slopes = u, (density, step, ramp), (0.0, 0.0, 0.0)
        weight = ramp_slope - slopes[2]
        first = (step_slope - slopes[1]) / second
        twice = (density_slope - slopes[0]) / second**2
        for c in range(joints):
            motion[0, c] += weight * values[i, c]
            motion[1, c] += first * values[i, c]
            motion[2, c] += twice * values[i, c]
        for c in range(joints, columns):
            carried[c - joints] += weight * values[i, c]
        squares += first * first
        density_slope, step_slope, ramp_slope = slopes
        u, (density, step, ramp) = u_next, following
    return motion, carried, np.sqrt(squares)


# Matching of two streams by time stamp: pressures interpolated to the stamps of the encoders.
#
# Measured forces take the place of the pressures.


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
        readings = [(i, reading) for i, source in enumerate(sources) for reading in source.readings]
        self.topics = tuple(dict.fromkeys(reading.stream for _, reading in readings))
        by_topic = [[pair for pair in readings if pair[1].stream == t] for t in self.topics]
        self._readings = [
            [(reading, Place(*reading.cell)) for _, reading in pairs] for pairs in by_topic
        ]
        self._adds_to = np.array([i for pairs in by_topic for i, _ in pairs])
        self._count = len(sources)
        # each joins one more topic to those before it
        self._stages = [Matcher(largest_gap) for _ in self.topics[1:]]

    def add(self, topic: str, stamp: int, message: Any) -> list[Gathered]:
        """Add a message and return the completed sample; `ValueError` if a field is missing."""
        place = self.topics.index(topic)
        numbers = np.array(
            [
                float(reading.in_si(np.array(at.number(message))))
                for reading, at in self._readings[place]
            ]
        )
        if place == 0:
            complete = [(stamp, numbers)]
        else:
            stage = self._stages[place - 1]
            complete = [
                (pair.stamp, np.concatenate(pair[1:]))
                for pair in stage.add_pressure(stamp, numbers)
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
