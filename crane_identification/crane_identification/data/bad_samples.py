"""Samples that cannot be what was measured: nothing that is plausible leads there and back.

A sample is judged by the velocities before and after it, against the noise around it, the noise of
the whole recording, one step of the sensor where it reads as much (numbers of five digits have
larger steps where they are larger), and how far the joint goes while stamps are off, or while a
state is sent again. What leaves the motion and comes back to it within
the time that may be bridged is taken out; what leaves it for good is refused. A state of all joints
that was sent again is taken out as well: it is older than its stamp says.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import LARGEST_GAP, regular
from crane_model.errors import DataError

QUANTISATION_STEPS = 4.0  # steps of the sensor that quantisation never makes
NOISE_QUANTILES = 8.0  # times the 0.75 quantile of all jumps, ...
MEDIAN_JUMPS = 10.0  # ... or times the median of those around
NEIGHBOURS = 25  # samples before and behind, that are around
BEND_FACTOR = 5.0  # times the median change of velocity around, which vibrations have everywhere
LATE_PERCENTILE = 95  # percentile of how far stamps are off, and of how often a state is sent again
CATCHING_UP_FACTOR = 2.0  # times as far as the joint goes meanwhile: it catches up behind
HELD_STEPS = 2.0  # steps that the joint goes on, if a reading that stays was sent again
# Share of samples that were sent again, from which on it is a habit of the sender
LEAST_REPEATED_SHARE = 0.005
# Share from which on the sensor is slow: `check_recording` reports its true rate
MOST_REPEATED_SHARE = 0.5
SPEED_SAMPLES = 5  # samples, over which a speed is measured that single bad ones do not spoil
FEWEST_LEVELS = 10  # readings of one order of magnitude that show its step
# Times what the joint reaches over LARGEST_GAP for a hundredth of the time
ACCELERATION_FACTOR = 10.0
SHOCK_RANGE_SHARE = 0.3  # of its range, to which a pressure or a force may really jump, and back
JUMP_SPEED_FACTOR = 10.0  # than everything else in the recording: no machine does that
LEAST_JUMP_SHARE = 0.02  # of the range of the recording, at least, that such a jump leads
MOST_BAD_SHARE = 0.05  # share of bad samples from which on the sensor is not to be trusted
MOST_NAMED_SAMPLES = 5  # bad samples that are named one by one


@dataclass(frozen=True)
class _Found:
    """Faults of one column: `bad` (n,), and `jumps`, samples from which on it is off."""

    bad: np.ndarray
    jumps: np.ndarray


def usable(log: Log, begin: float = 0.0, end: float = math.inf) -> Log:
    """`log` from `begin` to `end` [s], with NaN for bad positions, pressures and forces.

    A note names each, what held no number before, and how many states were sent again. Stamps that
    jitter are repaired first.
    `DataError` if they are many, or a position jumps and stays away: it names joint and sample.
    """
    log = regular(log)
    cleaned: dict[str, Any] = {}
    notes: list[str] = []
    again = _sent_again(log)
    if count := int(
        np.count_nonzero(again & (log.position.time >= begin) & (log.position.time <= end))
    ):
        notes.append(f"{log.position.origin}: {count} states that were sent again are left out")
    for name in ("position", "force", "pressure_a", "pressure_b"):
        signal: Signal | None = getattr(log, name)
        if signal is None:
            continue
        value = signal.value.copy()
        inside = (signal.time >= begin) & (signal.time <= end)
        for j, joint in enumerate(log.joints):
            what = f"{name.replace('_', ' ')} of {joint} ({signal.column(j)})"
            finite = np.isfinite(value[:, j])
            if absent := int(np.count_nonzero(inside & ~finite)):
                notes.append(f"{what}: {_samples(absent)} without a number")
            bad = _bad(log, what, signal, j, inside, name == "position")
            if len(bad):
                notes.append(
                    f"{what}: {_samples(len(bad))} left out, where no plausible "
                    f"{'acceleration' if name == 'position' else 'shock'} leads: "
                    f"{_which(signal, j, bad)}"
                )
                value[bad, j] = np.nan
        if np.array_equal(signal.time, log.position.time):
            value[again] = np.nan
        cleaned[name] = replace(signal, value=value)
    return replace(log, **cleaned, notes=(*log.notes, *notes)).during(begin, end)


def _repeats(value: np.ndarray) -> np.ndarray:
    """(n,) rows of (n, j) that are the row before."""
    return np.append(False, (np.diff(value, axis=0) == 0.0).all(axis=1))


def _sent_again(log: Log) -> np.ndarray:
    """(n,) rows in which no part of a state changed, although a joint went on by more than a step.

    Forces and pressures with the time stamps of the positions are part of the state. No row is
    marked unless the sender does this often, and each time for less than `LARGEST_GAP`.
    """
    time, value = log.position.time, log.position.value
    none = np.zeros(len(time), dtype=bool)
    repeats = _repeats(value)
    for signal in (log.force, log.pressure_a, log.pressure_b):
        if signal is not None and np.array_equal(signal.time, time):
            repeats &= _repeats(signal.value)
    if (
        repeats.mean() < LEAST_REPEATED_SHARE
        or not np.isfinite(value).all()
        or len(time) < 2 * NEIGHBOURS
    ):
        return none
    moves, interval = none.copy(), np.diff(time)
    for column in value.T:
        moves[1:] |= _speed(time, column) * interval > HELD_STEPS * _steps(column)
    again = repeats & moves
    edges = np.flatnonzero(np.diff(again, prepend=False, append=False))
    for first, behind in zip(edges[::2], edges[1::2], strict=True):
        if time[min(behind, len(time) - 1)] - time[first - 1] > LARGEST_GAP:
            again[first:behind] = False
    return (
        again
        if LEAST_REPEATED_SHARE < again.sum() / max(moves.sum(), 1) < MOST_REPEATED_SHARE
        else none
    )


def _bad(
    log: Log, what: str, signal: Signal, j: int, inside: np.ndarray, moves: bool
) -> np.ndarray:
    """Bad samples of column j that lie `inside` (n,); `DataError` if they cannot be repaired."""
    rows = np.flatnonzero(np.isfinite(signal.value[:, j]))
    if len(rows) < 2 * NEIGHBOURS:
        return rows[:0]
    found = _examine(signal.time[rows], signal.value[rows, j], moves)
    for jump in found.jumps[inside[rows[found.jumps]]]:
        before, after = signal.value[rows[[jump - 1, jump]], j]
        raise DataError(
            f"{log.source}: {what}: jumps from {before:.6g} to {after:.6g} at sample {rows[jump]}, "
            f"{signal.time[rows[jump]]:.4g} s, and does not come back: the sensor lost its count, "
            "or turned over; repair it, or keep one side with --from and --to"
        )
    bad = rows[found.bad & inside[rows]]
    if len(bad) > MOST_BAD_SHARE * np.count_nonzero(inside[rows]):
        raise DataError(
            f"{log.source}: {what}: nothing plausible leads to {_samples(len(bad))} of "
            f"{np.count_nonzero(inside[rows])}, {_which(signal, j, bad)}; check the sensor and "
            "its wiring"
        )
    return bad


def _samples(count: int) -> str:
    return f"{count} sample{'s' if count > 1 else ''}"


def _which(signal: Signal, j: int, bad: np.ndarray) -> str:
    parts = [f"sample {k} at {signal.time[k]:.4g} s ({signal.value[k, j]:.6g})" for k in bad]
    return ", ".join(parts[:MOST_NAMED_SAMPLES]) + (
        ", ..." if len(bad) > MOST_NAMED_SAMPLES else ""
    )


def _examine(time: np.ndarray, value: np.ndarray, moves: bool) -> _Found:
    """One column (n,) at times (n,) [s]; `moves`: a position, whose speed is bounded."""
    interval, size = np.diff(time), np.abs(_jumps(time, value))
    low, high = np.quantile(value, [0.01, 0.99])
    noise = NOISE_QUANTILES * float(np.quantile(size, 0.75))
    steps = _steps(value)
    limit = np.maximum(QUANTISATION_STEPS * steps, noise)
    if moves:
        speed = _speed(time, value)
        unread = (np.diff(value) == 0.0) & (speed * interval > HELD_STEPS * steps)
        limit += CATCHING_UP_FACTOR * _astray(interval, unread) * speed
    else:
        limit = np.maximum(limit, SHOCK_RANGE_SHARE * (high - low))
    suspects = size > limit
    limit += ACCELERATION_FACTOR * _acceleration(time, value, suspects) * interval**2
    suspects &= size > limit
    bend = np.abs(np.diff(np.diff(value) / interval, prepend=0.0)) * interval
    for k in np.flatnonzero(suspects).tolist():
        near = _near(k, len(size))
        limit[k] = max(
            limit[k],
            MEDIAN_JUMPS * float(np.median(size[near])),
            BEND_FACTOR * float(np.median(bend[near])),
        )
    jumps = np.flatnonzero(size > limit) + 1
    bad = np.zeros(len(value), dtype=bool)
    left = []
    for first, behind in _excursions(time, value, jumps, limit):
        bad[first:behind] = True
        if behind == first:
            left.append(first)
    if not moves:  # a pressure or a force may begin and end anywhere, and stay where it jumps
        bad[[0, -1]] = False
        return _Found(bad, np.empty(0, dtype=int))
    return _Found(bad, _away(time, value, np.array(left, dtype=int), bad))


def _acceleration(time: np.ndarray, value: np.ndarray, suspects: np.ndarray) -> float:
    """Acceleration that the joint reaches for a hundredth of the time, without suspect samples."""
    samples = max(round(LARGEST_GAP / float(np.median(np.diff(time)))), 2)
    if len(value) <= 2 * samples:
        return 0.0
    velocity = (value[samples:] - value[:-samples]) / (time[samples:] - time[:-samples])
    change = np.abs(velocity[samples:] - velocity[:-samples])
    counted = np.concatenate([[0], np.cumsum(suspects)])
    sound = counted[2 * samples :] == counted[: -2 * samples]
    if not sound.any():
        return 0.0
    return float(
        np.quantile((change / (time[2 * samples :] - time[samples:-samples]))[sound], 0.99)
    )


def _near(k: int, count: int) -> slice:
    return slice(max(k - NEIGHBOURS, 0), min(k + NEIGHBOURS + 1, count))


def _steps(value: np.ndarray) -> np.ndarray:
    """(n - 1,) smallest step between readings as large as those of each pair, from n readings.

    A table of so many digits has another step in each order of magnitude. Few readings in all show
    the step of a coarse sensor.
    """
    low, high = np.quantile(value, [0.01, 0.99])
    usual = (value >= low) & (value <= high)
    order = np.floor(np.log10(np.maximum(np.abs(value), np.finfo(float).tiny)))
    steps = np.full(len(value), np.nan)
    for magnitude in np.unique(order[usual]):
        inside = order == magnitude
        levels = np.unique(value[usual & inside])
        gaps = np.diff(levels)
        gaps = gaps[gaps > 1e-9 * (high - low)]
        if len(levels) >= FEWEST_LEVELS and len(gaps):
            steps[inside] = gaps.min()
    gaps = np.diff(np.unique(value[usual]))
    coarse = float(gaps[gaps > 1e-9 * (high - low)].min(initial=np.inf))
    smallest = float(np.nanmin(steps)) if np.isfinite(steps).any() else coarse
    smallest = smallest if np.isfinite(smallest) else 0.0
    steps = np.where(np.isnan(steps), smallest, steps)
    return np.maximum(steps[1:], steps[:-1])


def _astray(interval: np.ndarray, unread: np.ndarray) -> float:
    """Possible time error [s] of a sample: stamps are off, or a state is repeated, `unread`."""
    usual = float(np.median(interval))
    off = float(np.percentile(np.abs(interval - usual), LATE_PERCENTILE))
    edges = np.flatnonzero(np.diff(unread, prepend=False, append=False))
    runs = edges[1::2] - edges[::2]
    again = (
        float(np.percentile(runs, LATE_PERCENTILE))
        if len(runs) > LEAST_REPEATED_SHARE * len(interval)
        else 0.0
    )
    return off + usual * again


def _speed(time: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n - 1,) median speed around each pair of samples."""
    gone = np.abs(value[SPEED_SAMPLES:] - value[:-SPEED_SAMPLES]) / (
        time[SPEED_SAMPLES:] - time[:-SPEED_SAMPLES]
    )
    around = median_filter(gone, 2 * NEIGHBOURS + 1)
    return around[(np.arange(len(value) - 1) - SPEED_SAMPLES // 2).clip(0, len(around) - 1)]


def _jumps(time: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n - 1,) jumps beyond the velocity before and the one behind; 0 if one explains it."""
    interval = np.diff(time)
    velocity = np.diff(value) / interval
    before = np.diff(velocity, prepend=velocity[1])
    behind = -np.diff(velocity, append=velocity[-2])
    alike = np.sign(before) == np.sign(behind)
    return np.where(alike, np.sign(before) * np.minimum(np.abs(before), np.abs(behind)), 0.0) * (
        interval
    )


def _excursions(
    time: np.ndarray, value: np.ndarray, jumps: np.ndarray, limit: np.ndarray
) -> Iterator[tuple[int, int]]:
    """First sample of each excursion, and the one behind its last; the same if it does not end.

    It ends at a later one of the `jumps`, where the velocity before would have led, or with the
    recording, as it may begin with it.
    """
    i = 0
    while i < len(jumps):
        first = int(jumps[i])
        ends = [
            j
            for j in range(i + 1, len(jumps))
            if time[jumps[j]] - time[first - 1] <= LARGEST_GAP
            and _returns(time, value, first, int(jumps[j]), limit[first - 1])
        ]
        if ends:
            yield first, int(jumps[ends[0]])
            i = ends[0]
        elif first == 1:
            yield 0, 1
        elif first == len(value) - 1:
            yield first, first + 1
        else:
            yield first, first
        i += 1


def _returns(time: np.ndarray, value: np.ndarray, first: int, behind: int, limit: float) -> bool:
    """Return whether sample `behind` continues the motion before sample `first`."""
    begin = max(first - 4, 0)
    velocity = 0.0
    if first - 1 > begin:
        velocity = (value[first - 1] - value[begin]) / (time[first - 1] - time[begin])
    led = value[first - 1] + velocity * (time[behind] - time[first - 1])
    return bool(abs(value[behind] - led) <= limit)


def _away(time: np.ndarray, value: np.ndarray, jumps: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Those of the `jumps` that are faster by far than anything else, and for good.

    What lies between two of them, and could have moved there meanwhile, is marked as `bad`.
    """
    step = np.abs(np.diff(value))
    speed = step / np.diff(time)
    usual = ~(bad[1:] | bad[:-1])
    usual[jumps - 1] = False
    fastest = float(speed[usual].max(initial=0.0))
    low, high = np.quantile(value, [0.01, 0.99])
    far = (speed[jumps - 1] > JUMP_SPEED_FACTOR * fastest) & (
        step[jumps - 1] > LEAST_JUMP_SHARE * (high - low)
    )
    jumps, left, i = jumps[far], [], 0
    while i < len(jumps):
        first, behind = jumps[i], jumps[min(i + 1, len(jumps) - 1)]
        apart = abs(value[behind] - value[first - 1])
        if behind > first and apart <= fastest * (time[behind] - time[first - 1]):
            bad[first:behind] = True
            i += 2
        else:
            left.append(first)
            i += 1
    return np.array(left, dtype=int)
