"""Where, and with which period, a noise-free reference repeats itself."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from crane_model.errors import DataError

STEPS = 1.5
"""About equal: to within this many of the largest steps between two samples of the reference."""
WINDOW = 0.003
"""Share of the lag over which differences are averaged."""
TYPICAL = 0.9
SPREAD = 5.0
"""Equal: to within this many times the 0.9 quantile of the difference over the repeating part."""
SLACK = (16.0, 8.0, 4.0, 2.0, *(1.0,) * 16)
"""Multiples of about equal with which the search for the exact lag proceeds."""
SEARCHED = 3000
"""Samples of the signal, thinned, in which the period is sought; then it is found exactly."""
NEAR = 0.75
"""Of a step, within which the reference was recorded where it counts: what is interpolated over
samples that were not recorded must not end the part that repeats."""
ROUNDING = 1e-9
"""Share of the range of the reference below which differences are rounding."""
MOVES = 20.0
"""A part of the reference moves if its range is this many of the largest steps."""
LONGEST = 0.55
"""Share of the reference up to which lags are tried: two periods, and a little for the search."""
SEEN = 0.99
"""Share of a second period that must be there for the first to count as repeated: the very last
sample of two whole periods may be missing."""
GLIMPSED = 0.02
"""The same share where the period is given: less is chance agreement of crossing signals."""


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
    steps = max(round((time[-1] - time[0]) / float(np.median(np.diff(time)))), 1)
    uniform, step = np.linspace(time[0], time[-1], steps + 1, retstep=True)
    signal = _normalized(
        np.stack([np.interp(uniform, time, column) for column in reference.T], axis=1)
    )
    after = np.searchsorted(time, uniform).clip(1, len(time) - 1)
    away = np.minimum(np.abs(uniform - time[after - 1]), np.abs(time[after] - uniform))
    recorded = away <= NEAR * step
    largest_step = float(np.abs(np.diff(signal, axis=0)).max())
    about, moves = STEPS * largest_step, MOVES * largest_step
    lags = _candidates(signal) if period is None else np.array([period / step])
    for lag in lags:
        exact, first, last = _agreement(
            signal, recorded, float(lag), about, moves, period is not None
        )
        if last - first >= (SEEN if period is None else GLIMPSED) * exact and exact > lag / 2:
            length = exact * float(step)
            return Periodicity(length, float(uniform[first]), float(uniform[last]) + length)
    whole = f"{uniform[-1] - uniform[0]:.4g} s"
    if period is None:
        raise DataError(
            f"the reference does not repeat itself within its {whole}; record at least two whole "
            f"periods, give the period, or do not average"
        )
    raise DataError(
        f"the reference of {whole} does not repeat itself after the given period of {period} s; "
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
    """Lags at which the signal comes closest to itself, ascending, past the first rise.

    Close over one period somewhere: approach and stop, however long, do not shift the minimum.
    """
    thin = max(len(signal) // SEARCHED, 1)
    coarse = signal[::thin]
    lags = np.arange(1, int(LONGEST * len(coarse)))
    difference = np.array([_closest(coarse, int(lag)) for lag in lags])
    risen = int(np.argmax(difference > 0.5 * difference.mean()))
    inner = difference[1:-1]
    minimum = (inner <= difference[:-2]) & (inner <= difference[2:])
    found = np.flatnonzero(minimum) + 1
    return lags[found[found > risen]] * thin


def _closest(signal: np.ndarray, lag: int) -> float:
    """Least mean squared difference to the signal `lag` later, over a stretch as long."""
    squares = ((signal[lag:] - signal[:-lag]) ** 2).sum(axis=1)
    sums = np.cumsum(np.concatenate([[0.0], squares]))
    length = min(max(int(SEEN * lag), 1), len(squares))
    return float((sums[length:] - sums[:-length]).min()) / length


def _difference(signal: np.ndarray, lag: float) -> np.ndarray:
    """signal(k + lag) - signal(k) for every k at which both exist; linear between samples."""
    whole = round(lag) if abs(lag - round(lag)) < ROUNDING * lag else int(lag)
    share = max(lag - whole, 0.0)
    n = len(signal) - whole - (share > 0.0)
    ahead = signal[whole : whole + n]
    if share > 0.0:
        ahead = (1 - share) * ahead + share * signal[whole + 1 : whole + 1 + n]
    return ahead - signal[:n]


def _distance(signal: np.ndarray, recorded: np.ndarray, lag: float) -> np.ndarray:
    """Root mean square of that difference over all columns and the recorded ones of a window around
    every k; 0 where none of it was recorded."""
    power = (_difference(signal, lag) ** 2).sum(axis=1)
    n, whole = len(power), int(lag)
    seen = recorded[:n] & recorded[whole : whole + n]
    seen &= recorded[np.minimum(np.arange(n) + whole + 1, len(recorded) - 1)]
    weight = uniform_filter1d(seen.astype(float), _window(lag))
    mean = uniform_filter1d(power * seen, _window(lag)).clip(0.0)
    return np.sqrt(np.divide(mean, weight, out=np.zeros(n), where=weight > ROUNDING))


def _window(lag: float) -> int:
    return 2 * round(WINDOW * lag / 2) + 1


def _repeating(
    signal: np.ndarray, recorded: np.ndarray, lag: float, tolerance: float, moves: float
) -> tuple[int, int]:
    """First and last sample k of the longest moving part in which k and k + lag agree.

    Agreement around k is that of the whole window, so the part reaches half of it further.
    """
    equal = _distance(signal, recorded, lag) <= tolerance
    edges = np.flatnonzero(np.diff(equal, prepend=False, append=False)).reshape(-1, 2)
    span = int(np.ceil(lag))
    best = (0, 0)
    for begin, end in edges:
        moving = np.ptp(signal[begin : end + span], axis=0).max() > moves
        if moving and end - begin > best[1] - best[0]:
            best = (int(begin), int(end))
    if best == (0, 0):
        return best
    half = _window(lag) // 2
    return max(best[0] - half, 0), min(best[1] + half, len(equal)) - 1


def _agreement(
    signal: np.ndarray,
    recorded: np.ndarray,
    lag: float,
    about: float,
    moves: float,
    known: bool,
) -> tuple[float, int, int]:
    """The lag at which the signal agrees best with itself, and first and last sample k that do.

    What does not repeat shifts the minimum at which the search starts, so it starts tolerant and
    ends with the difference that interpolation and jitter make. A `known` lag is kept.
    """
    slope = np.gradient(signal, axis=0)
    equal = SLACK[0] * about
    for slack in SLACK:
        first, last = _repeating(signal, recorded, lag, equal, moves)
        if last <= first:
            break
        if not known:  # Gauss-Newton
            error, gradient = _difference(signal, lag)[first:last], slope[first:last]
            correction = float((error * gradient).sum() / (gradient**2).sum())
            lag = float(np.clip(lag - correction, 1.0, len(signal) - 3.0))
        spread = _distance(signal, recorded, lag)[first:last]
        if not len(spread):
            break
        equal = min(slack * about, SPREAD * float(np.quantile(spread, TYPICAL)) + ROUNDING)
    return lag, *_repeating(signal, recorded, lag, equal, moves)
