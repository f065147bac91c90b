"""Where, and with which period, a noise-free reference repeats itself."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from crane_model.errors import DataError

STEPS = 1.5
"""Equal means: to within this many of the largest steps between two samples of the reference."""
MOVES = 20.0
"""A part of the reference moves if its range is this many times what counts as equal."""


@dataclass(frozen=True)
class Periodicity:
    """The reference has the given `period` from `start` to `end` [s]."""

    period: float
    start: float
    end: float


def detect_periodicity(
    time: np.ndarray, reference: np.ndarray, period: float | None = None
) -> Periodicity:
    """Smallest lag at which the reference (n, j), stamped `time` (n,) [s], repeats, and where.

    Found without `period`, it must be seen at least twice; given one [s], the longest part that
    repeats after it is looked for. Standing still is not repeating. `DataError` if there is none.
    """
    step = float(np.median(np.diff(time)))
    uniform = time[0] + step * np.arange(int((time[-1] - time[0]) / step) + 1)
    signal = _normalized(
        np.stack([np.interp(uniform, time, column) for column in reference.T], axis=1)
    )
    tolerance = STEPS * float(np.abs(np.diff(signal, axis=0)).max())
    lags = _candidates(signal) if period is None else np.array([period / step])
    for lag in lags:
        exact = _refined(signal, float(lag), tolerance) if period is None else float(lag)
        first, last = _repeating(signal, exact, tolerance)
        if last - first >= (exact if period is None else 1.0):
            start = float(uniform[first])
            return Periodicity(exact * step, start, float(uniform[last]) + exact * step)
    length = f"{uniform[-1] - uniform[0]:.4g} s"
    if period is None:
        raise DataError(
            f"the reference does not repeat itself within its {length}; record at least two whole "
            f"periods, give the period, or do not average"
        )
    raise DataError(
        f"the reference of {length} does not repeat itself after the given period of {period} s; "
        f"give the period of the trajectory, or do not average"
    )


def _normalized(reference: np.ndarray) -> np.ndarray:
    """Moving columns only, each scaled to range 1."""
    ranges = np.ptp(reference, axis=0)
    if not ranges.any():
        raise DataError(
            "the reference stands still; without a period there is nothing to average over"
        )
    moving = ranges > 0
    return (reference[:, moving] - reference[:, moving].mean(axis=0)) / ranges[moving]


def _candidates(signal: np.ndarray) -> np.ndarray:
    """Lags at which the mean squared difference has a minimum, ascending, past the first rise."""
    n = len(signal)
    power = (signal**2).sum(axis=1)
    products = sum(fftconvolve(x, x[::-1])[n - 1 :] for x in signal.T)
    energy = np.concatenate([[0.0], np.cumsum(power)])
    lag = np.arange(n // 2 + 1)
    difference = (energy[n - lag] + energy[n] - energy[lag] - 2 * products[lag]) / (n - lag)
    risen = int(np.argmax(difference > 0.5 * difference.mean()))
    inner = difference[1:-1]
    minimum = (inner <= difference[:-2]) & (inner <= difference[2:])
    found = np.flatnonzero(minimum) + 1
    return found[found > risen]


def _difference(signal: np.ndarray, lag: float) -> np.ndarray:
    """signal(k + lag) - signal(k) for every k at which both exist; linear between samples."""
    whole = int(lag)
    share = lag - whole
    n = len(signal) - whole - 1
    ahead = (1 - share) * signal[whole : whole + n] + share * signal[whole + 1 : whole + 1 + n]
    return ahead - signal[:n]


def _repeating(signal: np.ndarray, lag: float, tolerance: float) -> tuple[int, int]:
    """First and last sample k of the longest moving part in which k and k + lag agree."""
    equal = (np.abs(_difference(signal, lag)) <= tolerance).all(axis=1)
    edges = np.flatnonzero(np.diff(equal, prepend=False, append=False)).reshape(-1, 2)
    span = int(np.ceil(lag))
    best = (0, 0)
    for begin, end in edges:
        moves = np.ptp(signal[begin : end + span], axis=0).max() > MOVES * tolerance
        if moves and end - 1 - begin > best[1] - best[0]:
            best = (int(begin), int(end) - 1)
    return best


def _refined(signal: np.ndarray, lag: float, tolerance: float) -> float:
    """The lag between samples that makes the repeating part agree best (Gauss-Newton)."""
    slope = np.gradient(signal, axis=0)
    longest = len(signal) - 3.0
    for _ in range(3):
        first, last = _repeating(signal, lag, tolerance)
        if last <= first:
            return lag
        error = _difference(signal, lag)[first:last]
        gradient = slope[first:last]
        correction = float((error * gradient).sum() / max((gradient**2).sum(), 1e-300))
        lag = float(np.clip(lag - np.clip(correction, -0.5, 0.5), 1.0, longest))
    return lag
