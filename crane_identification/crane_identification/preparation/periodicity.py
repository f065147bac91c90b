"""Periods of a motion: of a reference, or of measured positions."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numba import njit
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from crane_identification.data.log import Log
from crane_identification.data.resample import measured
from crane_identification.preparation.run import LACKING
from crane_model.errors import DataError, NoMotionError

RECORDED_STEP_SHARE = 0.75
"""Of a step, within which the motion was recorded where it counts: what is interpolated over
samples that were not recorded must not end the part that repeats."""
LEAST_RANGE_SHARE = 0.03
"""A part moves if its range is this share of that of the whole."""
LEAST_SCALED_RANGE = 0.3
"""Joints that move by less than this share of the one that moves most (rad or m) count by as much
less: what creeps, or only shows noise, does not hide that the others repeat."""
WINDOW_LAG_SHARE = 0.003
"""Share of the lag over which differences are averaged."""
EQUAL_STEPS = 1.5
"""About equal: to within this many of the largest steps between two samples, ..."""
EQUAL_RMS_FACTOR = 5.0
"""... or this many times the rms difference where the motion comes closest to itself."""
LEAST_COMPARED_SHARE = 0.25
"""Share of what can be compared that must repeat, where less than two periods are there."""
SPREAD_QUANTILE = 0.9
SPREAD_FACTOR = 5.0
"""Equal: to within this many times the 0.9 quantile of the difference over the repeating part."""
PASSING_RMS_SHARE = 0.2
"""Share of the rms of the motion up to which a difference interrupts the repeating part for a
moment, as friction that lets go later does, but does not end it."""
LASTING_LAG_SHARE = 0.02
"""Share of the lag that a part lasts at least in which the motion is equal."""
SLACK_FACTORS = (16.0, 8.0, 4.0, 2.0, *(1.0,) * 16)
"""Multiples of about equal with which the search for the exact lag proceeds."""
ROUNDING_RANGE_SHARE = 1e-9
"""Share of the range below which differences are rounding."""
MOVING_LAG_SHARE = 0.1
"""Share of the lag around a sample in which a joint moves if it does at all."""
REPEATING_RMS_SHARE = 0.05
"""A motion repeats if it differs from itself by less than this share of its own rms."""
LONGER_PERIOD_FACTOR = 3.0
"""A longer period is meant if the motion then differs from itself so many times less, ..."""
VISIBLE_RMS_SHARE = 0.004
"""... and by more than this share of its rms after the shorter one."""
LEAST_PERIOD_SHARE = 0.99
"""Share of a second period that must be there for the first to count as repeated: the very last
sample of two whole periods may be missing."""
PERIOD_TOLERANCE = 5e-4
"""Share of a given period, beside one sample, by which it may be off."""
SEARCH_SAMPLES = 3000
"""Samples of the motion, thinned, in which the period is sought; then it is found exactly."""
LONGEST_LAG_SHARE = 0.55
"""Share of the motion up to which lags are tried: two periods, and a little for the search."""
EQUAL_RMS_SHARE = 1e-6
"""Rms difference, as a share of the range, up to which whole periods repeat equally well."""
LATEST_END_SHARE = 0.05
"""Share of the lag."""


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
        """Find the period of positions (n, j) at times (n,) [s]; `DataError` if nothing moves."""
        steps = max(round((time[-1] - time[0]) / float(np.median(np.diff(time)))), 1)
        uniform, step = np.linspace(time[0], time[-1], steps + 1, retstep=True)
        ranges = np.ptp(position, axis=0)
        if not ranges.any():
            raise NoMotionError("the motion stands still, and so does not repeat")
        scaled = position / np.maximum(ranges, LEAST_SCALED_RANGE * ranges.max())
        signal = np.stack([np.interp(uniform, time, column) for column in scaled.T], axis=1)
        after = np.searchsorted(time, uniform).clip(1, len(time) - 1)
        away = np.minimum(np.abs(uniform - time[after - 1]), np.abs(time[after] - uniform))
        centred = signal - signal.mean(axis=0)
        return cls(centred, away <= RECORDED_STEP_SHARE * step, float(time[0]), float(step))

    @property
    def samples(self) -> int:
        return len(self.signal)

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Sums of the first 0, 1, ... n samples (n + 1, j), and of their squares (n + 1,)."""
        zero = np.zeros((1, self.signal.shape[1]))
        squares = (self.signal**2).sum(axis=1)
        return (
            np.cumsum(np.concatenate([zero, self.signal]), axis=0),
            np.cumsum(np.concatenate([[0.0], squares])),
        )

    def nearest(self, lag: int, overlap: float = 1.0) -> tuple[float, float]:
        """Least difference to the motion `lag` later over a stretch as long, or this share of what
        overlaps: over the rms of one period there, and as it is. Infinite if none moves."""
        length = min(lag, int(overlap * (self.samples - lag)))
        if length < 1:
            return np.inf, np.inf
        share, difference = _nearest(self.signal, *self._sums, lag, length, LEAST_RANGE_SHARE**2)
        return float(np.sqrt(share)), float(np.sqrt(difference))


@njit(cache=True)
def _nearest(
    signal: np.ndarray, sums: np.ndarray, powers: np.ndarray, lag: int, length: int, moves: float
) -> tuple[float, float]:
    """Least mean square difference to the signal `lag` samples later over `length` samples, over
    twice the power of one period from there on, and as it is; infinite where that is no more than
    the share `moves` of the mean power.
    """
    samples, joints = signal.shape
    running = np.zeros(samples - lag + 1)
    for i in range(samples - lag):
        square = 0.0
        for j in range(joints):
            square += (signal[i + lag, j] - signal[i, j]) ** 2
        running[i + 1] = running[i] + square
    best, there, least = np.inf, np.inf, moves * powers[-1] / samples
    for i in range(min(len(running) - length, samples + 1 - lag)):
        mean = 0.0
        for j in range(joints):
            mean += ((sums[i + lag, j] - sums[i, j]) / lag) ** 2
        power = (powers[i + lag] - powers[i]) / lag - mean
        difference = max((running[i + length] - running[i]) / length, 0.0)  # sums round
        if power > least and difference / (2.0 * power) < best:
            best, there = difference / (2.0 * power), difference
    return best, there


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
    _, scatter = motion.nearest(round(lag), LEAST_COMPARED_SHARE)
    about = max(
        EQUAL_STEPS * float(np.abs(np.diff(signal, axis=0)).max()), EQUAL_RMS_FACTOR * scatter
    )
    equal = SLACK_FACTORS[0] * about
    for slack in SLACK_FACTORS:
        first, last = _part(motion, lag, equal)
        if last <= first:
            return None
        if not known:  # Gauss-Newton
            error, gradient = _repeated_difference(signal, lag)[first:last], slope[first:last]
            power = float((gradient**2).sum())
            correction = float((error * gradient).sum()) / power if power > 0.0 else 0.0
            lag = float(np.clip(lag - correction, 1.0, len(signal) - 3.0))
            if not given / 2 < lag < 2 * given:
                return None
        spread = distance(motion, lag)[first:last]
        if not len(spread):
            return None
        equal = min(
            slack * about,
            SPREAD_FACTOR * float(np.quantile(spread, SPREAD_QUANTILE)) + ROUNDING_RANGE_SHARE,
        )
    first, last = _part(motion, lag, equal, PASSING_RMS_SHARE)
    if last <= first:
        return None
    there = distance(motion, lag)[first:last]
    rms = _rms(signal[first : last + int(lag)])
    return Agreement(lag, first, last, float(np.sqrt((there**2).mean() / 2.0)) / rms)


def distance(motion: Repetition, lag: float) -> np.ndarray:
    """Rms of the difference around every sample; 0 where none of it was recorded."""
    recorded = motion.recorded
    power = (_repeated_difference(motion.signal, lag) ** 2).sum(axis=1)
    n, whole = len(power), int(lag)
    seen = recorded[:n] & recorded[whole : whole + n]
    seen &= recorded[np.minimum(np.arange(n) + whole + 1, len(recorded) - 1)]
    weight = uniform_filter1d(seen.astype(float), _window(lag))
    mean = uniform_filter1d(power * seen, _window(lag)).clip(0.0)
    return np.sqrt(np.divide(mean, weight, out=np.zeros(n), where=weight > ROUNDING_RANGE_SHARE))


def _moves(motion: Repetition, lag: float) -> np.ndarray:
    """(n,) whether anything moves around a sample; standing still repeats for any lag."""
    window = 2 * int(MOVING_LAG_SHARE * lag / 2) + 1
    low, high = minimum_filter1d, maximum_filter1d
    travel = high(motion.signal, window, axis=0) - low(motion.signal, window, axis=0)
    return travel.max(axis=1) > MOVING_LAG_SHARE * LEAST_RANGE_SHARE


def _part(
    motion: Repetition, lag: float, tolerance: float, passing: float = 0.0
) -> tuple[int, int]:
    """First and last sample of the part that moves longest and is equal to itself `lag` later.

    Equality around a sample is that of the whole window, so the part reaches half of it further.
    Inside, differences of up to the share `passing` of the motion may pass.
    """
    apart = distance(motion, lag)
    span = int(np.ceil(lag))
    moves = np.concatenate([[0], np.cumsum(_moves(motion, lag))])
    parts = [
        (begin, end)
        for begin, end in _runs(apart <= tolerance)
        if np.ptp(motion.signal[begin : end + span], axis=0).max() > LEAST_RANGE_SHARE
    ]
    best = max(parts, key=lambda part: moves[part[1]] - moves[part[0]], default=(0, 0))
    if moves[best[0]] == moves[best[1]]:
        return 0, 0
    if passing > 0.0:
        allowed = max(tolerance, passing * _rms(motion.signal[best[0] : best[1] + span]))
        begin, end = next(r for r in _runs(apart <= allowed) if r[0] <= best[0] < r[1])
        shortest = LASTING_LAG_SHARE * lag
        equal = [run for run in _runs(apart[begin:end] <= tolerance) if run[1] - run[0] >= shortest]
        if equal:
            best = (begin + equal[0][0], begin + equal[-1][1])
    half = _window(lag) // 2
    return max(best[0] - half, 0), min(best[1] + half, len(apart)) - 1


def _repeated_difference(signal: np.ndarray, lag: float) -> np.ndarray:
    """signal(k + lag) - signal(k) for every k at which both exist; linear between samples."""
    whole = round(lag) if abs(lag - round(lag)) < ROUNDING_RANGE_SHARE * lag else int(lag)
    share = max(lag - whole, 0.0)
    n = len(signal) - whole - (share > 0.0)
    ahead = signal[whole : whole + n]
    if share > 0.0:
        ahead = (1 - share) * ahead + share * signal[whole + 1 : whole + 1 + n]
    return ahead - signal[:n]


def _rms(signal: np.ndarray) -> float:
    """RMS of a signal (n, j) around its mean, over all joints together."""
    return float(np.sqrt(signal.var(axis=0).sum()))


def _window(lag: float) -> int:
    return 2 * round(WINDOW_LAG_SHARE * lag / 2) + 1


def _runs(where: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(where, prepend=False, append=False))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


@dataclass(frozen=True)
class Periodicity:
    """The motion has the given `period` from `start` to `end` [s]."""

    period: float
    start: float
    end: float


def periodic_part(log: Log, period: float | None) -> Periodicity:
    """The part of `log` that repeats after `period` [s] (None: to be found).

    The reference, which has no noise, says it best; where none repeats, the positions do. They
    decide whether the machine did. `DataError` if not.
    """
    position = measured(log, log.position)
    if log.reference_position is not None:
        try:
            reference = measured(log, log.reference_position)
            part = detect_periodicity(reference.time, reference.value, period)
        except DataError:
            pass  # it stands still, or something else moved the machine
        else:
            motion = Repetition.of(position.time, position.value)
            difference = _difference(motion, part.period / motion.step)
            if (
                difference <= REPEATING_RMS_SHARE
                or part.end - part.start < 2 * LEAST_PERIOD_SHARE * part.period
            ):
                return part
            raise DataError(
                f"{log.source}: {reference.origin} repeats after {part.period:.4g} s, but the "
                f"measured motion does not: it then differs by {difference:.0%} of its rms; cut "
                "off with --from and --to what did not follow the reference"
            )
    try:
        return detect_periodicity(position.time, position.value, period)
    except DataError as error:
        raise type(error)(f"{log.source}: {error}") from None


def detect_periodicity(
    time: np.ndarray, position: np.ndarray, period: float | None = None
) -> Periodicity:
    """Smallest lag at which `position` (n, j), stamped `time` (n,) [s], repeats, and where.

    Found without `period`, it must be seen at least twice; given one [s], it is checked, and kept,
    where the motion lasts longer than that. Standing still is not repeating. `DataError` if the
    motion does not repeat, or not after the given period: it says by how much, and when it does.

    >>> time = np.arange(0.0, 10.0, 0.01)
    >>> round(detect_periodicity(time, np.sin(np.pi * time)[:, np.newaxis]).period, 3)
    2.0
    """
    motion = Repetition.of(time, position)
    return _found(motion) if period is None else _checked(motion, period)


def _found(motion: Repetition) -> Periodicity:
    best: Agreement | None = None
    compared = _compared(motion)
    for lag in _candidates(compared, REPEATING_RMS_SHARE):
        found = agreement(motion, lag)
        if (
            found is None
            or found.last - found.first < LEAST_PERIOD_SHARE * found.lag
            or found.difference > REPEATING_RMS_SHARE
        ):
            continue
        if best is None or found.difference < best.difference / LONGER_PERIOD_FACTOR:
            best = found
        if best.difference <= VISIBLE_RMS_SHARE:
            break
    if best is not None:
        return _periodicity(motion, best, best.lag * motion.step)
    lag, difference = _closest(motion, compared)
    raise DataError(
        f"the motion does not repeat within its {_duration(motion):.4g} s: where it comes closest, "
        f"after {lag * motion.step:.4g} s, it still differs by {difference:.0%} of its rms; record "
        "at least two whole periods, cut off what is not periodic with --from and --to, or give "
        "the period with --period"
    )


def _checked(motion: Repetition, period: float) -> Periodicity:
    lag = period / motion.step
    overlap = motion.samples - 1 - lag
    if overlap < 1.0:
        if overlap < -1.5:
            raise DataError(
                f"lasts {_duration(motion):.4g} s, less than the given period of {period:g} s; "
                "correct --period"
            )
        apart = _gap_at_the_ends(motion)
        if apart > REPEATING_RMS_SHARE:
            raise DataError(
                f"after the given period of {period:g} s the motion is not where it began: the "
                f"ends are {apart:.0%} of its rms apart; correct --period"
            )
        return Periodicity(period, motion.start, motion.start + _duration(motion))
    near = agreement(motion, lag)
    wanted = min(LEAST_PERIOD_SHARE * lag, LEAST_COMPARED_SHARE * overlap)
    if (
        near is not None
        and near.last - near.first >= wanted
        and near.difference <= REPEATING_RMS_SHARE
    ):
        off = abs(near.lag - lag)
        if off <= 1.0 + PERIOD_TOLERANCE * lag:
            return _periodicity(motion, agreement(motion, lag, known=True) or near, period)
    difference = _difference(motion, lag)
    try:
        found = f"it repeats after {_found(motion).period:.5g} s"
    except DataError:
        found = (
            f"it repeats after {near.lag * motion.step:.5g} s"
            if near is not None
            and near.last - near.first >= wanted
            and near.difference <= REPEATING_RMS_SHARE
            else "nor does it after any other time"
        )
    raise DataError(
        f"the motion does not repeat after the given period of {period:g} s: it then differs by "
        f"{difference:.0%} of its rms; {found}; correct --period, or leave it out"
    )


class _Compared(NamedTuple):
    """A motion against itself: least differences (l,) at `lags` (l,), and that of `one_step`."""

    lags: np.ndarray
    difference: np.ndarray
    one_step: float


def _candidates(compared: _Compared, within: float) -> list[float]:
    """Lags at which the motion comes closest to itself, ascending, past the first rise.

    Closer than `within`, as a share of its rms, over one period somewhere: approach and stop,
    however long, do not shift the minimum.
    """
    lags, difference, one_step = compared
    inner = difference[1:-1]
    lowest = (inner <= difference[:-2]) & (inner <= difference[2:])
    found = np.flatnonzero(lowest & (inner <= within + one_step)) + 1
    return lags[found].tolist()


def _closest(motion: Repetition, compared: _Compared) -> tuple[float, float]:
    """Lag at which the motion comes closest to itself, and by how much it then differs."""
    lags, difference, _ = compared
    if not len(lags):
        return float(motion.samples - 1), 1.0
    return float(lags[difference.argmin()]), float(min(difference.min(), 1.0))


def _difference(motion: Repetition, lag: float) -> float:
    """The least difference to the motion `lag` samples later, over one period somewhere."""
    return min(motion.nearest(round(lag))[0], 1.0)


def _duration(motion: Repetition) -> float:
    """From the first to the last sample [s]."""
    return (motion.samples - 1) * motion.step


def _gap_at_the_ends(motion: Repetition) -> float:
    """How far the motion ends from where one step on from its end it would be periodic."""
    ahead = motion.signal[-1] + (motion.signal[-1] - motion.signal[-2]) - motion.signal[0]
    rms = np.sqrt((motion.signal**2).sum(axis=1).mean())
    return float(np.linalg.norm(ahead) / rms)


def _compared(motion: Repetition) -> _Compared:
    thin = -(-motion.samples // SEARCH_SAMPLES)
    coarse = replace(motion, signal=motion.signal[::thin])
    lags = np.arange(1, int(LONGEST_LAG_SHARE * coarse.samples))
    difference = np.array([coarse.nearest(int(lag))[0] for lag in lags])
    risen = int(np.argmax(difference > 0.5 * np.minimum(difference, 1.0).mean()))
    power = 2.0 * (coarse.signal**2).sum(axis=1).mean()
    step = np.sqrt((np.diff(coarse.signal, axis=0) ** 2).sum(axis=1).mean() / power)
    return _Compared(lags[risen:] * thin, difference[risen:], float(step))


def _periodicity(motion: Repetition, part: Agreement, period: float) -> Periodicity:
    start, end = (
        motion.start + motion.step * index for index in (part.first, _best_end(motion, part))
    )
    return Periodicity(period, start, min(end + period, motion.start + _duration(motion)))


def _best_end(motion: Repetition, part: Agreement) -> int:
    """Sample at which the whole periods that repeat best end, near the end of the part.

    A machine that runs down leaves its path so slowly that its position is equal for a while when
    its acceleration is not.
    """
    compared = int((part.last - part.first + LACKING) / part.lag) * round(part.lag)
    slack = part.last - part.first - compared
    if compared < 1 or slack < 1:
        return part.last
    sums = np.cumsum(np.concatenate([[0.0], distance(motion, part.lag) ** 2]))
    begins = part.last - compared - np.arange(min(slack, int(LATEST_END_SHARE * part.lag)) + 1)
    cost = sums[begins + compared] - sums[begins]
    alike = cost <= cost.min() + compared * EQUAL_RMS_SHARE**2
    return int(begins[alike.argmax()] + compared)
