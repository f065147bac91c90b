"""The course of a joint between the counts of its encoder."""

import numpy as np


def between_counts(time: np.ndarray, reading: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Positions (m,) at the times `at` (m,), in counts, from readings (n,) of counts at `time`.

    While a joint creeps its reading stands, and then changes by a whole count, which is no motion
    of a whole count: when it changes, the joint is halfway. So these crossings are joined by lines,
    with the readings that differ from those before and behind.
    """
    stands = np.abs(np.diff(reading)) < 0.5
    beside = np.pad(stands, 1)  # (n + 1,) before and behind each reading
    lone = ~(beside[:-1] | beside[1:])
    lone[[0, -1]] = True
    crossing = ~stands & (beside[:-2] | beside[2:])
    times = np.concatenate([time[lone], 0.5 * (time[:-1] + time[1:])[crossing]])
    places = np.concatenate([reading[lone], 0.5 * (reading[:-1] + reading[1:])[crossing]])
    order = np.argsort(times)
    return np.interp(at, times[order], places[order])
