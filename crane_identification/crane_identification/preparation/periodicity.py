"""Where, and with which period, a motion repeats itself: a reference, or measured positions."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import measured
from crane_identification.preparation.averaging import LACKING
from crane_identification.preparation.repetition import (
    OVERLAP,
    Agreement,
    Repetition,
    agreement,
    distance,
)
from crane_model.errors import DataError

REPEATS = 0.05
"""A motion repeats if it differs from itself by less than this share of its own rms."""
CLEARLY = 3.0
"""A longer period is meant if the motion then differs from itself so many times less, ..."""
VISIBLY = 0.004
"""... and by more than this share of its rms after the shorter one."""
SEEN = 0.99
"""Share of a second period that must be there for the first to count as repeated: the very last
sample of two whole periods may be missing."""
EXACT = 5e-4
"""Share of a given period, beside one sample, by which it may be off."""
SEARCHED = 3000
"""Samples of the motion, thinned, in which the period is sought; then it is found exactly."""
LONGEST = 0.55
"""Share of the motion up to which lags are tried: two periods, and a little for the search."""
ALIKE = 1e-6
"""Rms difference, as a share of the range, up to which whole periods repeat equally well."""
NEARLY = 0.05
"""Share of the lag."""


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
            if difference <= REPEATS or part.end - part.start < 2 * SEEN * part.period:
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
    for lag in _candidates(compared, REPEATS):
        one = agreement(motion, lag)
        if one is None or one.last - one.first < SEEN * one.lag or one.difference > REPEATS:
            continue
        if best is None or one.difference < best.difference / CLEARLY:
            best = one
        if best.difference <= VISIBLY:
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
    """The part that repeats after a given period."""
    lag = period / motion.step
    overlap = motion.samples - 1 - lag
    if overlap < 1.0:
        if overlap < -1.5:
            raise DataError(
                f"lasts {_duration(motion):.4g} s, less than the given period of {period:g} s; "
                "correct --period"
            )
        apart = _gap_at_the_ends(motion)
        if apart > REPEATS:
            raise DataError(
                f"after the given period of {period:g} s the motion is not where it began: the "
                f"ends are {apart:.0%} of its rms apart; correct --period"
            )
        return Periodicity(period, motion.start, motion.start + _duration(motion))
    near = agreement(motion, lag)
    wanted = min(SEEN * lag, OVERLAP * overlap)
    if near is not None and near.last - near.first >= wanted and near.difference <= REPEATS:
        off = abs(near.lag - lag)
        if off <= 1.0 + EXACT * lag:
            return _periodicity(motion, agreement(motion, lag, known=True) or near, period)
    difference = _difference(motion, lag)
    try:
        found = f"it repeats after {_found(motion).period:.5g} s"
    except DataError:
        found = (
            f"it repeats after {near.lag * motion.step:.5g} s"
            if near is not None and near.last - near.first >= wanted and near.difference <= REPEATS
            else "nor does it after any other time"
        )
    raise DataError(
        f"the motion does not repeat after the given period of {period:g} s: it then differs by "
        f"{difference:.0%} of its rms; {found}; correct --period, or leave it out"
    )


class _Compared(NamedTuple):
    """A motion with itself later: `lags` (l,) past the first rise, the least difference (l,) at
    each, and what `one_step` makes.
    """

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
    thin = -(-motion.samples // SEARCHED)
    coarse = replace(motion, signal=motion.signal[::thin])
    lags = np.arange(1, int(LONGEST * coarse.samples))
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
    """Sample at which the whole periods end that repeat best, up to `NEARLY` before the part does.

    A machine that runs down leaves its path so slowly that its position is equal for a while when
    its acceleration is not.
    """
    compared = int((part.last - part.first + LACKING) / part.lag) * round(part.lag)
    slack = part.last - part.first - compared
    if compared < 1 or slack < 1:
        return part.last
    sums = np.cumsum(np.concatenate([[0.0], distance(motion, part.lag) ** 2]))
    begins = part.last - compared - np.arange(min(slack, int(NEARLY * part.lag)) + 1)
    cost = sums[begins + compared] - sums[begins]
    alike = cost <= cost.min() + compared * ALIKE**2
    return int(begins[alike.argmax()] + compared)
