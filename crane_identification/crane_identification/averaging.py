"""Averaging over periods (37)-(38), and the noise that the scatter between periods reveals."""

from dataclasses import dataclass

import numpy as np

TRANSIENT = 2.0
"""A first period that differs from the later ones by this many times their scatter is transient."""


@dataclass(frozen=True)
class Averaging:
    """How a recording was averaged.

    `period` [s]; `used` whole periods, the last ones; `transient` whole periods before them were
    left out, and `incomplete` [s] of the periodic part fills no whole period.
    """

    period: float
    used: int
    transient: int
    incomplete: float


def fold(values: np.ndarray, length: int, periods: int) -> np.ndarray:
    """The last `periods` whole periods of `values` (n, ...): (periods, length, ...)."""
    last = values[len(values) - periods * length :]
    return last.reshape(periods, length, *values.shape[1:])


def transient_periods(position: np.ndarray) -> int:
    """How many of the first of M periods (M, n, j) belong to the transient.

    A period is compared with the mean of those behind it, while these are at least two.
    """
    first = 0
    while len(position) - first >= 3:
        later = position[first + 1 :]
        scatter = np.sqrt((later.var(axis=0, ddof=1)).mean(axis=0))
        expected = scatter * np.sqrt(1 + 1 / len(later))
        deviation = np.sqrt(((position[first] - later.mean(axis=0)) ** 2).mean(axis=0))
        if not (deviation > TRANSIENT * expected).any():
            break
        first += 1
    return first


def noise_of_mean(periods: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Root mean square noise (j,) left in the average of M periods (M, n, j), without any model.

    Over the `used` (n, j) samples; NaN for a single period, which has no scatter.
    """
    count = len(periods)
    if count < 2:
        return np.full(periods.shape[2], np.nan)
    variance = np.where(used, periods.var(axis=0, ddof=1), 0.0).sum(axis=0)
    return np.sqrt(variance / np.maximum(used.sum(axis=0), 1) / count)
