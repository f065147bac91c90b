"""The gate of the offline regression, as samples come: the sign of a velocity must be known."""

import numpy as np

from crane_identification.online.smoother import Smoothed
from crane_identification.signals.gate import SIGMAS


class Gate:
    """Tells how long each joint has moved one way.

    As offline, speeds below 3 standard deviations of the velocity estimate count as standstill,
    where (13) is set-valued, and a row with standstill, a reversal or the begin of a run in its
    window is not used: the friction force of (13) jumps there, and the smoothed one does not.
    """

    def __init__(self, noise: np.ndarray):
        self._noise = noise  # (j,) standard deviation of a single reading
        self._direction = np.zeros(len(noise))
        self._since = np.zeros(len(noise), dtype=np.int64)  # ns, begin of this direction
        self._run = -1

    def add(self, smoothed: Smoothed) -> None:
        """The next velocities."""
        direction = np.sign(smoothed.velocity)
        direction[np.abs(smoothed.velocity) <= self.resolution(smoothed)] = 0.0
        turned = direction != self._direction
        if smoothed.run != self._run:
            self._run = smoothed.run
            turned[:] = True
        self._since[turned] = smoothed.stamp
        self._direction = direction

    def open(self, begin: int) -> np.ndarray:
        """Which joints (j,) moved one way at every velocity from `begin` [ns] on."""
        return (self._direction != 0.0) & (self._since <= begin)

    def resolution(self, smoothed: Smoothed) -> np.ndarray:
        """Speed (j,) below which the sign of this estimate is not known."""
        return SIGMAS * self._noise * smoothed.velocity_gain
