"""Encoders that jump: one step between two readings that no piston can have gone."""

import numpy as np
from numba import njit

from crane_model.array import Array

BESIDE = 6  # steps before and behind one, that tell how fast the joint moves
BEYOND = 5.0  # times what the largest of them is off, of a jump
ROUNDED = 12.0**-0.5  # of a step, that rounding is off
NOTHING = 1e-9  # rad, m: what numbers round
GAP = 0.1  # s between two readings, behind which all begins anew
STEPS = 8.0  # of the encoder, at least


class JumpWatch:
    """Of s encoders. A step is judged once as many have come behind it as are looked at before it:
    noise, and a stamp or a reading that is late, show in their neighbours, too.
    """

    def __init__(self, sensors: int):
        self._time = np.full(2 * BESIDE + 2, -np.inf)
        self._shown = np.full((2 * BESIDE + 2, sensors), np.nan)
        self._step = np.full(sensors, np.inf)
        self.size = np.zeros(sensors)  # (s,) rad, m: the last jump since `forget`; 0: none
        self.deviation = np.zeros(sensors)  # (s,) of the size
        self.at = np.zeros(sensors)  # (s,) s

    def forget(self) -> None:
        """Those that were told."""
        self.size[:] = 0.0

    def add(self, time: float, shown: Array) -> None:
        """Readings (s,) of one time [s]; those that are no numbers, or of no later time, do not
        count.
        """
        if not np.isfinite(shown).all() or time <= self._time[-1]:
            return
        if time - self._time[-1] > GAP:
            self._shown[:] = np.nan
        self._time[:-1], self._shown[:-1] = self._time[1:], self._shown[1:]
        self._time[-1], self._shown[-1] = time, shown
        _judge(self._time, self._shown, self._step, self.size, self.deviation, self.at)


@njit(cache=True, error_model="numpy")
def _judge(
    time: Array, shown: Array, least: Array, size: Array, deviation: Array, at: Array
) -> None:
    """Put a jump of the middle step, of readings (n, s), into `size`, `deviation` and `at` (s,);
    `least` (s,) is what each encoder resolves: the smallest difference of two steps of it.
    """
    lasting = time[1:] - time[:-1]
    for i in range(shown.shape[1]):
        steps = shown[1:, i] - shown[:-1, i]
        more = abs(steps[-1] - steps[-2])
        if NOTHING < more < least[i]:
            least[i] = more
        if not np.isfinite(steps[0]):
            continue
        off = steps - lasting * np.median(steps / lasting)
        jump, others = off[BESIDE], np.abs(np.delete(off, BESIDE))
        stays = 0.5 < np.sum(off) / jump < 1.5  # what a stamp does, its neighbours take back
        if stays and abs(jump) > max(BEYOND * others.max(), STEPS * least[i]):
            size[i] = jump
            deviation[i] = max(np.sqrt(np.mean(others**2)), least[i] * ROUNDED)
            at[i] = time[BESIDE + 1]
