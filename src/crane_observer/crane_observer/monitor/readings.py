"""What single readings tell: values that never change, noise that grew, chambers changed over."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array, Flags

LOOKED = 60  # samples, 0.3 s at 200 Hz
PINNED = 400  # samples, 2 s: longer than a load that swings keeps a chamber beyond what is shown
LATELY = 12  # samples
REPEATS = 0.7  # share of repeated readings, above which a sensor that repeats itself is nothing new
SLOWLY = 2e-4  # of each sample in what is usual: over 5000 of them
FIRST = 400  # samples before anything is usual
DIFFERENCE = np.array([-4.0, 6.0, -4.0, 1.0])  # of the four readings before, newest first
GAIN = 70.0**0.5  # of the fourth difference, for white noise
MEDIAN = 0.6745  # standard deviations
NOISIER = 4.0  # times what is usual


class ReadingHabits:
    """Of s sensors: how often a reading repeats the last, and how rough its course is.

    Roughness is the fourth difference, which a smooth motion hardly has. What is usual is learnt
    while nothing is wrong. Readings are taken as they were read: between two of them lies no step
    of the converter, and none of its noise.
    """

    def __init__(self, sensors: int, full: float = np.inf):
        """From `full` on, a sensor is at the end of what it can show."""
        self._full = full
        self._last = np.full((len(DIFFERENCE), sensors), np.nan)
        self._rough = np.full((LOOKED, sensors), np.nan)
        self._same = np.zeros(sensors, dtype=np.int64)
        self._usual_rough, self._usual_same, self._step = np.zeros((3, sensors))
        self._count = 0

    def add(self, shown: Array) -> None:
        """Readings (s,) of one time; those with something that is no number do not count."""
        self._count += _note(
            shown, self._count, self._last, self._rough, self._same, self._usual_rough,
            self._usual_same, self._step,
        )  # fmt: skip

    @property
    def stuck(self) -> Flags:
        """(s,) whether a sensor that flickers has shown one value for LOOKED samples, or for PINNED
        at its end, where it shows that value of whatever is beyond.
        """
        flickers = (self._usual_same < REPEATS) & (self._count > FIRST)
        wanted = np.where(self._last[0] < self._full, LOOKED, PINNED)
        return np.asarray(flickers & (self._same >= wanted))

    @property
    def repeated(self) -> Array:
        """(s,) how many times the last reading was repeated."""
        return self._same.astype(float)

    @property
    def noise(self) -> Array:
        """(s,) how rough the last LOOKED samples were, in units of the sensor; NaN at first."""
        if self._count < LOOKED + 4:
            return np.full(self._last.shape[1], np.nan)
        return np.asarray(np.median(self._rough, axis=0)) / MEDIAN

    @property
    def noisy_now(self) -> Flags:
        """(s,) the same of the last LATELY samples alone: no proof, but a hint when others ask."""
        if self._count < FIRST:
            return np.zeros(self._last.shape[1], dtype=bool)
        rows = (self._count - 1 - np.arange(LATELY)) % LOOKED
        lately = np.median(self._rough[rows], axis=0) / MEDIAN
        return np.asarray(lately > 0.75 * NOISIER * np.maximum(self._usual_rough, self._step))

    @property
    def noisy(self) -> Flags:
        """(s,) whether that is a multiple of what is usual, and of what rounding makes."""
        if self._count < FIRST:
            return np.zeros(self._last.shape[1], dtype=bool)
        usual = np.maximum(self._usual_rough, self._step)
        return np.asarray(self.noise > NOISIER * usual)


@njit(cache=True, error_model="numpy")
def _note(
    shown: Array,
    count: int,
    last: Array,
    roughness: Array,
    same: NDArray[np.int64],
    usual_rough: Array,
    usual_same: Array,
    step: Array,
) -> int:
    """Take readings (s,) behind `count` others into the arrays of `ReadingHabits`; 0 if they do not
    count, else 1.
    """
    for one in shown:
        if not math.isfinite(one):
            return 0
    for i in range(len(shown)):
        if count > 3:
            rough = shown[i]
            for k in range(len(DIFFERENCE)):
                rough += DIFFERENCE[k] * last[k, i]
            rough = abs(rough) / GAIN
            way = abs(shown[i] - last[0, i])
            changed = way > 0.0
            same[i] = 0 if changed else same[i] + 1
            if changed and (way < step[i] or step[i] == 0.0):
                step[i] = way
            roughness[count % LOOKED, i] = rough
            weight = max(SLOWLY, 1.0 / count)
            if same[i] < LOOKED // 3:
                usual_same[i] += weight * ((0.0 if changed else 1.0) - usual_same[i])
            if count >= FIRST:
                rough = min(rough, NOISIER * usual_rough[i] + step[i])
            usual_rough[i] += weight * (rough - usual_rough[i])
        for k in range(len(DIFFERENCE) - 1, 0, -1):
            last[k, i] = last[k - 1, i]
        last[0, i] = shown[i]
    return 1
