"""The part of a motion that repeats, and after which time exactly."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from crane_identification.preparation.averaging import LACKING
from crane_identification.preparation.repetition import MOVES, Repetition

WINDOW = 0.003
"""Share of the lag over which differences are averaged."""
STEPS = 1.5
"""About equal: to within this many of the largest steps between two samples, ..."""
SCATTER = 5.0
"""... or this many times the rms difference where the motion comes closest to itself."""
OVERLAP = 0.25
"""Share of what can be compared that must repeat, where less than two periods are there."""
TYPICAL = 0.9
SPREAD = 5.0
"""Equal: to within this many times the 0.9 quantile of the difference over the repeating part."""
PASSING = 0.2
"""Share of the rms of the motion up to which a difference interrupts the repeating part for a
moment, as friction that lets go later does, but does not end it."""
LASTING = 0.02
"""Share of the lag that a part lasts at least in which the motion is equal."""
SLACK = (16.0, 8.0, 4.0, 2.0, *(1.0,) * 16)
"""Multiples of about equal with which the search for the exact lag proceeds."""
ROUNDING = 1e-9
"""Share of the range below which differences are rounding."""
ALIKE = 1e-6
"""Rms difference, as a share of the range, up to which whole periods repeat equally well."""
NEARLY = 0.05
"""Share of the lag."""
AROUND = 0.1
"""Share of the lag around a sample in which a joint moves if it does at all."""


@dataclass(frozen=True)
class Agreement:
    """The motion is equal to itself `lag` samples later from sample `first` to `last`.

    `difference`: rms difference over the rms of the motion in that part.
    """

    lag: float
    first: int
    last: int
    difference: float


def agreement(motion: Repetition, lag: float, known: bool = False) -> Agreement | None:
    """The lag near `lag` at which the motion agrees best with itself, and where it does.

    What does not repeat shifts the minimum at which the search starts, so it starts tolerant and
    ends with the difference that noise, interpolation and jitter make. A `known` lag is kept. None
    if it agrees nowhere.
    """
    signal, given = motion.signal, lag
    slope = np.gradient(signal, axis=0)
    _, scatter = motion.nearest(round(lag), OVERLAP)
    about = max(STEPS * float(np.abs(np.diff(signal, axis=0)).max()), SCATTER * scatter)
    equal = SLACK[0] * about
    for slack in SLACK:
        first, last = _part(motion, lag, equal)
        if last <= first:
            return None
        if not known:  # Gauss-Newton
            error, gradient = _difference(signal, lag)[first:last], slope[first:last]
            power = float((gradient**2).sum())
            correction = float((error * gradient).sum()) / power if power > 0.0 else 0.0
            lag = float(np.clip(lag - correction, 1.0, len(signal) - 3.0))
            if not given / 2 < lag < 2 * given:
                return None
        spread = _distance(motion, lag)[first:last]
        if not len(spread):
            return None
        equal = min(slack * about, SPREAD * float(np.quantile(spread, TYPICAL)) + ROUNDING)
    first, last = _part(motion, lag, equal, PASSING)
    if last <= first:
        return None
    there = _distance(motion, lag)[first:last]
    rms = _rms(signal[first : last + int(lag)])
    return Agreement(lag, first, last, float(np.sqrt((there**2).mean() / 2.0)) / rms)


def _distance(motion: Repetition, lag: float) -> np.ndarray:
    """Rms of the difference over all joints and the recorded samples of a window around every
    sample; 0 where none of it was recorded."""
    recorded = motion.recorded
    power = (_difference(motion.signal, lag) ** 2).sum(axis=1)
    n, whole = len(power), int(lag)
    seen = recorded[:n] & recorded[whole : whole + n]
    seen &= recorded[np.minimum(np.arange(n) + whole + 1, len(recorded) - 1)]
    weight = uniform_filter1d(seen.astype(float), _window(lag))
    mean = uniform_filter1d(power * seen, _window(lag)).clip(0.0)
    return np.sqrt(np.divide(mean, weight, out=np.zeros(n), where=weight > ROUNDING))


def _moves(motion: Repetition, lag: float) -> np.ndarray:
    """(n,) whether anything moves around a sample; standing still repeats for any lag."""
    window = 2 * int(AROUND * lag / 2) + 1
    low, high = minimum_filter1d, maximum_filter1d
    travel = high(motion.signal, window, axis=0) - low(motion.signal, window, axis=0)
    return travel.max(axis=1) > AROUND * MOVES


def best_end(motion: Repetition, part: Agreement) -> int:
    """Sample at which the whole periods end that repeat best, up to `NEARLY` before the part does.

    A machine that runs down leaves its path so slowly that its position is equal for a while when
    its acceleration is not.
    """
    compared = int((part.last - part.first + LACKING) / part.lag) * round(part.lag)
    slack = part.last - part.first - compared
    if compared < 1 or slack < 1:
        return part.last
    sums = np.cumsum(np.concatenate([[0.0], _distance(motion, part.lag) ** 2]))
    begins = part.last - compared - np.arange(min(slack, int(NEARLY * part.lag)) + 1)
    cost = sums[begins + compared] - sums[begins]
    alike = cost <= cost.min() + compared * ALIKE**2
    return int(begins[alike.argmax()] + compared)


def _part(
    motion: Repetition, lag: float, tolerance: float, passing: float = 0.0
) -> tuple[int, int]:
    """First and last sample of the part that moves longest and is equal to itself `lag` later.

    Equality around a sample is that of the whole window, so the part reaches half of it further.
    Inside, differences of up to the share `passing` of the motion may pass.
    """
    distance = _distance(motion, lag)
    span = int(np.ceil(lag))
    moves = np.concatenate([[0], np.cumsum(_moves(motion, lag))])
    parts = [
        (begin, end)
        for begin, end in _runs(distance <= tolerance)
        if np.ptp(motion.signal[begin : end + span], axis=0).max() > MOVES
    ]
    best = max(parts, key=lambda part: moves[part[1]] - moves[part[0]], default=(0, 0))
    if moves[best[0]] == moves[best[1]]:
        return 0, 0
    if passing > 0.0:
        allowed = max(tolerance, passing * _rms(motion.signal[best[0] : best[1] + span]))
        begin, end = next(r for r in _runs(distance <= allowed) if r[0] <= best[0] < r[1])
        shortest = LASTING * lag
        equal = [
            run for run in _runs(distance[begin:end] <= tolerance) if run[1] - run[0] >= shortest
        ]
        if equal:
            best = (begin + equal[0][0], begin + equal[-1][1])
    half = _window(lag) // 2
    return max(best[0] - half, 0), min(best[1] + half, len(distance)) - 1


def _difference(signal: np.ndarray, lag: float) -> np.ndarray:
    """signal(k + lag) - signal(k) for every k at which both exist; linear between samples."""
    whole = round(lag) if abs(lag - round(lag)) < ROUNDING * lag else int(lag)
    share = max(lag - whole, 0.0)
    n = len(signal) - whole - (share > 0.0)
    ahead = signal[whole : whole + n]
    if share > 0.0:
        ahead = (1 - share) * ahead + share * signal[whole + 1 : whole + 1 + n]
    return ahead - signal[:n]


def _rms(signal: np.ndarray) -> float:
    """Of a signal (n, j) around its mean, over all joints together."""
    return float(np.sqrt(signal.var(axis=0).sum()))


def _window(lag: float) -> int:
    return 2 * round(WINDOW * lag / 2) + 1


def _runs(where: np.ndarray) -> list[tuple[int, int]]:
    """Begin and end of each run of True."""
    edges = np.flatnonzero(np.diff(where, prepend=False, append=False))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
