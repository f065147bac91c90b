"""How closely a motion comes to itself a while later."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from crane_model.errors import DataError

SEARCHED = 3000
"""Samples of the motion, thinned, in which the period is sought; then it is found exactly."""
NEAR = 0.75
"""Of a step, within which the motion was recorded where it counts: what is interpolated over
samples that were not recorded must not end the part that repeats."""
MOVES = 0.03
"""A part moves if its range is this share of that of the whole."""
HARDLY = 0.3
"""Joints that move by less than this share of the one that moves most (rad or m) count by as much
less: what creeps, or only shows noise, does not hide that the others repeat."""
LONGEST = 0.55
"""Share of the motion up to which lags are tried: two periods, and a little for the search."""


@dataclass(frozen=True)
class Repetition:
    """A motion on a uniform time base, joints scaled to range 1, or less if they hardly move.

    `signal` (n, j) from `start` every `step` [s]; `recorded` (n,): not interpolated over a gap.
    """

    signal: np.ndarray
    recorded: np.ndarray
    start: float
    step: float

    @classmethod
    def of(cls, time: np.ndarray, position: np.ndarray) -> Self:
        """Of positions (n, j) at times (n,) [s]; `DataError` if nothing moves."""
        steps = max(round((time[-1] - time[0]) / float(np.median(np.diff(time)))), 1)
        uniform, step = np.linspace(time[0], time[-1], steps + 1, retstep=True)
        ranges = np.ptp(position, axis=0)
        if not ranges.any():
            raise DataError("the motion stands still, and so does not repeat")
        scaled = position / np.maximum(ranges, HARDLY * ranges.max())
        signal = np.stack([np.interp(uniform, time, column) for column in scaled.T], axis=1)
        after = np.searchsorted(time, uniform).clip(1, len(time) - 1)
        away = np.minimum(np.abs(uniform - time[after - 1]), np.abs(time[after] - uniform))
        centred = signal - signal.mean(axis=0)
        return cls(centred, away <= NEAR * step, float(time[0]), float(step))

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.signal)

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return (self.samples - 1) * self.step

    def candidates(self, within: float) -> list[float]:
        """Lags at which the motion comes closest to itself, ascending, past the first rise.

        Closer than `within`, as a share of its rms, over one period somewhere: approach and stop,
        however long, do not shift the minimum.
        """
        lags, difference, one_step = self._differences()
        inner = difference[1:-1]
        lowest = (inner <= difference[:-2]) & (inner <= difference[2:])
        found = np.flatnonzero(lowest & (inner <= within + one_step)) + 1
        return lags[found].tolist()

    def closest(self) -> tuple[float, float]:
        """Lag at which the motion comes closest to itself, and by how much it then differs."""
        lags, difference, _ = self._differences()
        if not len(lags):
            return float(self.samples - 1), 1.0
        return float(lags[difference.argmin()]), float(min(difference.min(), 1.0))

    def difference(self, lag: float) -> float:
        """The least difference to the motion `lag` samples later, over one period somewhere."""
        return min(self.nearest(round(lag))[0], 1.0)

    def gap_at_the_ends(self) -> float:
        """How far the motion ends from where one step on from its end it would be periodic."""
        ahead = self.signal[-1] + (self.signal[-1] - self.signal[-2]) - self.signal[0]
        rms = np.sqrt((self.signal**2).sum(axis=1).mean())
        return float(np.linalg.norm(ahead) / rms)

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the first 0, 1, ... n samples (n + 1, j), and of their squares (n + 1,)."""
        zero = np.zeros((1, self.signal.shape[1]))
        squares = (self.signal**2).sum(axis=1)
        return (
            np.cumsum(np.concatenate([zero, self.signal]), axis=0),
            np.cumsum(np.concatenate([[0.0], squares])),
        )

    def nearest(self, lag: int, overlap: float = 1.0) -> tuple[float, float]:
        """Least difference to the motion `lag` later over a stretch as long, or this share of what
        overlaps: over the rms of one period there, and as it is. Infinite if none moves."""
        squares = ((self.signal[lag:] - self.signal[:-lag]) ** 2).sum(axis=1)
        length = min(lag, int(overlap * len(squares)))
        if length < 1:
            return np.inf, np.inf
        sums = np.cumsum(np.concatenate([[0.0], squares]))
        difference = ((sums[length:] - sums[:-length]) / length).clip(0.0)  # sums round
        last = min(len(difference), self.samples + 1 - lag)
        difference = difference[:last]
        sums, powers = self._sums
        mean = (sums[lag : lag + last] - sums[:last]) / lag
        power = (powers[lag : lag + last] - powers[:last]) / lag - (mean**2).sum(axis=1)
        moves = power > MOVES**2 * powers[-1] / self.samples
        if not moves.any():
            return np.inf, np.inf
        share = difference[moves] / (2.0 * power[moves])
        best = int(share.argmin())
        return float(np.sqrt(share[best])), float(np.sqrt(difference[moves][best]))

    def _differences(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Lags past the first rise, the least difference at each, and what one step makes."""
        thin = -(-self.samples // SEARCHED)
        coarse = replace(self, signal=self.signal[::thin])
        lags = np.arange(1, int(LONGEST * coarse.samples))
        difference = np.array([coarse.nearest(int(lag))[0] for lag in lags])
        risen = int(np.argmax(difference > 0.5 * np.minimum(difference, 1.0).mean()))
        power = 2.0 * (coarse.signal**2).sum(axis=1).mean()
        step = np.sqrt((np.diff(coarse.signal, axis=0) ** 2).sum(axis=1).mean() / power)
        return lags[risen:] * thin, difference[risen:], float(step)
