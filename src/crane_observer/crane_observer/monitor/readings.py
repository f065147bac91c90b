"""What single readings tell: values that never change, noise that grew, chambers changed over."""

import numpy as np

from crane_model.array import Array, Flags

LOOKED = 60  # samples, 0.3 s at 200 Hz
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

    def __init__(self, sensors: int):
        self._last = np.full((len(DIFFERENCE), sensors), np.nan)
        self._rough = np.full((LOOKED, sensors), np.nan)
        self._same = np.zeros(sensors, dtype=int)
        self._usual_rough, self._usual_same, self._step = np.zeros((3, sensors))
        self._count = 0

    def add(self, shown: Array) -> None:
        """Readings (s,) of one time; those with something that is no number do not count."""
        if not np.isfinite(shown).all():
            return
        if self._count > 3:
            rough = np.abs(shown + DIFFERENCE @ self._last) / GAIN
            changed = shown != self._last[0]
            self._same = np.where(changed, 0, self._same + 1)
            way = np.abs(shown - self._last[0])
            finer = changed & ((way < self._step) | (self._step == 0.0))
            self._step = np.where(finer, way, self._step)
            self._rough[self._count % LOOKED] = rough
            weight = max(SLOWLY, 1.0 / self._count)
            calm = self._same < LOOKED // 3
            self._usual_same += np.where(calm, weight * (~changed - self._usual_same), 0.0)
            limit = np.where(self._count < FIRST, np.inf, NOISIER * self._usual_rough + self._step)
            self._usual_rough += weight * (np.minimum(rough, limit) - self._usual_rough)
        self._last[1:], self._last[0] = self._last[:-1].copy(), shown
        self._count += 1

    @property
    def stuck(self) -> Flags:
        """(s,) whether a sensor that flickers has shown one value for LOOKED samples."""
        flickers = (self._usual_same < REPEATS) & (self._count > FIRST)
        return np.asarray(flickers & (self._same >= LOOKED))

    @property
    def repeated(self) -> Array:
        """(s,) how many times the last reading was repeated."""
        return self._same

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
