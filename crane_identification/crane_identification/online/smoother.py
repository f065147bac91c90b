"""Fixed-lag smoothing of the motion, and the same linear operator on the forces.

The operator S convolves the linear interpolation of the readings with the kernel

    s(t) = 315/512 (3 - 11 u²) (1 - u²)³ / lag,  u = t/lag,  |u| < 1.

Its derivatives are exact: (Sq)' and (Sq)'' are the convolutions with s' and s''. S leaves
polynomials up to degree 3 as they are, which makes φ(Sq) equal to Sφ(q) up to the fourth order of
lag, and passes motion up to 0.78/lag (-3 dB). So lag has to be short beside everything the crane
does, its swinging on the oil included; rows are made of many instants (see `window`).

Why no fixed-lag Kalman smoother: its velocity is no derivative of its position while the gains
settle, it never quite forgets a bad reading, and its gains would follow every jitter of the stamps
for each joint. S knows nothing that is older than two lags.

Convolving a piecewise linear signal leaves divided differences of the kernel's integrals at the
stamps as weights of the readings, whatever the stamps: straight lines stay exact under any jitter,
and constants leave no trace in the derivatives.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from crane_bags.clocks import NANOSECONDS

SHORTEST_INTERVAL = 250_000  # ns; readings closer together than this are the same


class Smoothed(NamedTuple):
    """What S gives at one instant `stamp` [ns] of the uninterrupted stretch number `run`.

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
