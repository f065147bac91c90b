"""The gate of the offline regression, as samples come: the sign of a velocity must be known."""

from collections import deque

import numpy as np

from crane_identification.online.smoother import Smoothed
from crane_identification.signals.gate import SIGMAS


class Gate:
    """Lets the row of a joint through if it moved one way over all that the smoother saw of it.

    As offline, speeds below 3 standard deviations of the velocity estimate count as standstill,
    where (13) is set-valued, and a row closer than `guard` [ns] to standstill, to a reversal or to
    the begin of its run is not used: the friction force of (13) jumps there and the smoothed one
    does not. The velocity that is tested must be smoothed less than the rows, or it would not show
    how a joint sticks and slips within their window.
    """

    def __init__(self, noise: np.ndarray, guard: int):
        self._noise = noise  # (j,) standard deviation of a single reading
        self._guard = guard
        self._waiting: deque[Smoothed] = deque()
        self._direction = np.zeros(len(noise))
        self._since = np.zeros(len(noise), dtype=np.int64)  # ns, begin of this direction
        self._run = -1

    def add_row(self, row: Smoothed) -> None:
        """A row to be decided upon; it comes out of `add_velocity`."""
        self._waiting.append(row)

    def add_velocity(self, fine: Smoothed) -> list[tuple[Smoothed, np.ndarray]]:
        """Rows about which the velocities up to this one decide, with whether to use them (j,)."""
        direction = np.sign(fine.velocity)
        direction[np.abs(fine.velocity) <= self.resolution(fine)] = 0.0
        turned = direction != self._direction
        if fine.run != self._run:
            self._run = fine.run
            self._waiting = deque(row for row in self._waiting if row.run == fine.run)
            turned[:] = True
        self._since[turned] = fine.stamp
        self._direction = direction
        out = []
        while self._waiting and self._waiting[0].stamp + self._guard <= fine.stamp:
            row = self._waiting.popleft()
            out.append((row, (direction != 0.0) & (self._since <= row.stamp - self._guard)))
        return out

    def resolution(self, smoothed: Smoothed) -> np.ndarray:
        """Speed (j,) below which the sign of this estimate is not known."""
        return SIGMAS * self._noise * smoothed.velocity_gain
