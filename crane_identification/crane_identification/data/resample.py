"""From asynchronous signals to samples on one uniform time base."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from crane_identification.data.log import Log, Signal
from crane_identification.signals.motion import encoder_resolution, reading_resolution
from crane_model.errors import DataError

SHORTEST_RUN = 20  # samples; nothing can be smoothed or differentiated on less
LARGEST_GAP = 0.1  # s, bridged; longer ones split a recording
SPARSEST = 1000.0  # times as long as its samples can fill, no recording lasts
LONGEST_COUNTED = 5  # median intervals; of longer ones nobody knows how many samples they are
LOW_PASS_ORDER, LOW_PASS_BAND = 8, 0.8  # of the low-pass, the latter of half the rate behind it
LOW_PASS_PADDING = 6 * LOW_PASS_ORDER  # samples
SLOWER = 1.2  # times faster, at least, a signal must be to be filtered and slowed down
SYNCHRONISED_SAMPLES = 100  # with which the search for a regular clock begins
SYNCHRONISED_RATES = np.linspace(0.95, 1.05, 401)  # of the median one, that are tried on them
STAMP_MARGIN_S = 1e-9  # s, the resolution of stamps; times closer than this are the same
REQUIRED = ("position", "force", "pressure_a", "pressure_b")
INTERPOLATED = (
    "velocity",
    "force",
    "pressure_a",
    "pressure_b",
    "supply_pressure",
    "tank_pressure",
    "slew_position",
    "reference_position",
    "reference_velocity",
    "reference_acceleration",
    "temperature",
)


@dataclass(frozen=True)
class Samples:
    """n samples of j joints, every 1/`rate` s inside each run; None is not logged.

    Time [s] is that of the log; between runs it jumps by a whole number of samples.
    """

    source: str
    joints: tuple[str, ...]
    rate: float  # Hz
    time: np.ndarray  # (n,) s
    run: np.ndarray  # (n,) int, 0, 1, ...
    position: np.ndarray  # (n, j) rad or m
    velocity: np.ndarray | None  # (n, j) as logged, per s
    force: np.ndarray | None  # (n, j) generalized force, N m or N
    pressure_a: np.ndarray | None  # (n, j) Pa gauge
    pressure_b: np.ndarray | None  # (n, j) Pa gauge
    supply_pressure: np.ndarray | None  # (n,) Pa gauge
    tank_pressure: np.ndarray | None  # (n,) Pa gauge
    slew_position: np.ndarray | None  # (n,) rad
    command: np.ndarray | None  # (n, j) valve command, -1..1
    reference_position: np.ndarray | None  # (n, j) rad or m
    reference_velocity: np.ndarray | None  # (n, j) per s
    reference_acceleration: np.ndarray | None  # (n, j) per s²
    temperature: np.ndarray | None  # (n,) deg C

    def __len__(self) -> int:
        return len(self.time)


def resample(log: Log, rate: float | None = None, largest_gap: float = LARGEST_GAP) -> Samples:
    """Positions, forces and pressures of a log, linearly interpolated at the same times.

    rate: [Hz]; None: that of the positions. largest_gap: [s]; where positions, forces or pressures
    of a joint (NaN are none) are further apart, the samples are split into runs.
    The other signals do not split: they are interpolated too (the command holds its last value),
    each column for itself, with NaN where it was not logged yet, no more, or not for `largest_gap`
    and two of its own intervals. `DataError` if too little is left.
    """
    required = {
        name: measured(log, getattr(log, name), largest_gap)
        for name in REQUIRED
        if getattr(log, name)
    }
    rate = rate or sampling_rate(required["position"].time)
    begin = max(signal.time[0] for signal in required.values())
    end = min(_last_seen(signal) for signal in required.values())
    time = begin + np.arange(int((end - begin + STAMP_MARGIN_S) * rate) + 1) / rate
    covered = np.ones(len(time), dtype=bool)
    for signal in required.values():
        covered &= ~_inside_gap(signal, time, largest_gap)
    run = _runs(covered)
    if not (run >= 0).any():
        raise DataError(
            f"{log.source}: positions and pressures or forces were never logged together for "
            f"{SHORTEST_RUN / rate:.3g} s without a gap of {largest_gap} s; record again, or allow "
            "larger gaps"
        )
    time, run = time[run >= 0], run[run >= 0]

    def interpolated(name: str) -> np.ndarray | None:
        signal = required.get(name) or getattr(log, name)
        return None if signal is None else _by_column(_interpolated, signal, time, largest_gap)

    return Samples(
        source=log.source,
        joints=log.joints,
        rate=rate,
        time=time,
        run=run,
        position=_by_column(_interpolated, required["position"], time, largest_gap),
        command=None if log.command is None else _by_column(_held, log.command, time, largest_gap),
        **{name: interpolated(name) for name in INTERPOLATED},
    )


def regular(log: Log) -> Log:
    """`log` with regular times in place of stamps that jitter, and a note; else as it is.

    The likelihood of the positions decides: if the samples were taken at regular times, a moving
    joint seems to shake along its stamps, and does not along the regular times. Rate and phase of
    those are fitted, for which they pay (Bayesian information criterion). Signals with the stamps
    of the positions change with them.
    """
    time, value = log.position.time, log.position.value
    times = _regular_times(time)
    if times is None or _evidence(value, time, times) <= np.log(len(time)):
        return log
    off, interval = 1e3 * float(np.std(time - times)), 1e3 / sampling_rate(times)
    note = (
        f"{log.position.origin}: stamps are off by {off:.2g} ms (rms); the motion says that its "
        f"samples are regular, {interval:.4g} ms apart, and so they are used"
    )
    changed: dict[str, Any] = {
        name: replace(signal, time=times)
        for name in ("position", "command", *INTERPOLATED)
        if (signal := getattr(log, name)) is not None and np.array_equal(signal.time, time)
    }
    return replace(log, **changed, notes=(*log.notes, note))


def _regular_times(time: np.ndarray) -> np.ndarray | None:
    """Times (n,) [s] of a regular clock nearest to the stamps; None if they follow none.

    Rate and phase are found on the first samples, and then on twice as many until all are used.
    """
    if len(time) < SYNCHRONISED_SAMPLES:
        return None
    known = SYNCHRONISED_SAMPLES
    rates = sampling_rate(time) * SYNCHRONISED_RATES
    turns = np.exp(2j * np.pi * rates[:, np.newaxis] * time[:known])
    interval = 1.0 / float(rates[np.abs(turns.sum(axis=1)).argmax()])
    while True:
        intervals = time[:known] / interval
        phase = float(np.angle(np.exp(2j * np.pi * intervals).mean())) / (2 * np.pi)
        number = np.round(intervals - phase)
        interval, begin = np.polyfit(number, time[:known], 1).tolist()
        if known == len(time):
            break
        known = min(2 * known, len(time))
    times: np.ndarray = begin + interval * number
    return times if (np.diff(number) > 0).all() else None


def _evidence(value: np.ndarray, stamps: np.ndarray, times: np.ndarray) -> float:
    """Logarithm of how much likelier the positions (n, j) make `times` (n,) than `stamps` (n,).

    The noise around straight lines is that of Cauchy, which outliers and rests spoil least; its
    scale is the median, and a step of the encoder.
    """
    evidence, value = 0.0, np.where(np.isfinite(value), value, np.nan)
    for column, step in zip(value.T, encoder_resolution(value).tolist(), strict=True):
        at_stamps, at_times = _bends(column, stamps), _bends(column, times)
        scale = step + min(np.median(at_stamps), np.median(at_times)) if len(at_times) else 0.0
        if scale > 0.0:
            evidence += np.log((scale**2 + at_stamps**2) / (scale**2 + at_times**2)).sum()
    return evidence


def _bends(value: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Distances of values from the line through their neighbours, in the noise of one value.

    Each value counts once.
    """
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    bends = value[1:-1] - value[:-2] - share * (value[2:] - value[:-2])
    bends = (np.abs(bends) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2))[::3]
    return bends[np.isfinite(bends)]


def slowed(log: Log, rate: float | None) -> Log:
    """`log` with its measured signals at `rate` [Hz], behind a low-pass against aliases.

    Butterworth of order 8, run forwards and backwards, up to 0.8 of half the rate, the same for
    positions and forces. Signals that are not faster stay as they are; so do commands, which
    hold their value. What is missing for longer than `LARGEST_GAP` stays missing.
    """
    if rate is None:
        return log
    changed: dict[str, Any] = {
        name: _slowed(signal, rate)
        for name in ("position", *INTERPOLATED[:7])
        if (signal := getattr(log, name)) is not None
    }
    return replace(log, **changed)


def _slowed(signal: Signal, rate: float) -> Signal:
    fast = sampling_rate(signal.time)
    if fast < SLOWER * rate:
        return signal
    sections = butter(LOW_PASS_ORDER, LOW_PASS_BAND * rate / fast, output="sos")
    time = np.arange(np.ceil(signal.time[0] * rate), signal.time[-1] * rate + STAMP_MARGIN_S) / rate
    value = signal.value.reshape(len(signal.time), -1)
    out = np.full((len(time), value.shape[1]), np.nan)
    for into, column in zip(out.T, value.T, strict=True):
        known = np.flatnonzero(np.isfinite(column))
        breaks = np.flatnonzero(np.diff(signal.time[known]) > LARGEST_GAP + STAMP_MARGIN_S) + 1
        for rows in np.split(known, breaks):
            begin, end = (signal.time[rows[0]], signal.time[rows[-1]]) if len(rows) else (0, 0)
            even = np.arange(begin, end + STAMP_MARGIN_S, 1.0 / fast)
            if len(even) <= LOW_PASS_PADDING:
                continue
            smooth = sosfiltfilt(
                sections, np.interp(even, signal.time[rows], column[rows]), padlen=LOW_PASS_PADDING
            )
            inside = (time >= even[0] - STAMP_MARGIN_S) & (time <= even[-1] + STAMP_MARGIN_S)
            into[inside] = CubicSpline(even, smooth)(time[inside])
    received = None if signal.received is None else np.interp(time, signal.time, signal.received)
    finer = reading_resolution(value) * np.sqrt(rate / fast)
    return replace(
        signal,
        time=time,
        value=out.reshape(len(time), *signal.value.shape[1:]),
        received=received,
        resolution=finer,
    )


def sampling_rate(time: np.ndarray) -> float:
    """Rate [Hz] of stamps (n,) that jitter and have gaps, from their median interval.

    An interval counts as the number of median intervals that it is nearest to, which makes the
    result as good as the mean where samples are missing; longer gaps do not count.
    """
    intervals = np.diff(time)
    periods = np.round(intervals / np.median(intervals))
    counted = periods <= LONGEST_COUNTED
    return float(np.sum(periods[counted]) / np.sum(intervals[counted]))


def measured(log: Log, signal: Signal, largest_gap: float = LARGEST_GAP) -> Signal:
    """The samples of `signal` that hold a number for every joint, or could be bridged.

    What a joint lacks for at most `largest_gap` [s] is interpolated from its own samples.
    `DataError` if few samples are left, or the clock
    leaps.
    """
    value = signal.value.copy()
    for column in value.T:
        _bridge(signal.time, column, largest_gap)
    complete = np.isfinite(value).all(axis=1)
    count = np.count_nonzero(complete)
    if count < SHORTEST_RUN:
        raise DataError(
            f"{log.source}: {signal.origin}: {count} samples that hold a number for each of "
            f"{', '.join(log.joints)}, at least {SHORTEST_RUN} needed; check the sensors"
        )
    time = signal.time[complete]
    span, filled = time[-1] - time[0], count * float(np.median(np.diff(time)))
    if span > SPARSEST * filled:
        raise DataError(
            f"{log.source}: {signal.origin}: {span:.4g} s from the first to the last stamp, but "
            f"its samples fill only {filled:.4g} s; check the clock that stamped them, or cut with "
            "--from and --to"
        )
    return Signal(time, value[complete], signal.origin, latency=signal.latency)


class Interruption(NamedTuple):
    """Time without samples: `begin` and `length` [s]."""

    begin: float
    length: float


def interruptions(signal: Signal, largest_gap: float = LARGEST_GAP) -> list[Interruption]:
    """The gaps of a signal that `resample` does not bridge."""
    value = signal.value.reshape(len(signal.time), -1).copy()
    for column in value.T:
        _bridge(signal.time, column, largest_gap)
    time = signal.time[np.isfinite(value).all(axis=1)]
    pairs = zip(time[:-1].tolist(), np.diff(time).tolist(), strict=True)
    return [Interruption(*pair) for pair in pairs if pair[1] > largest_gap + STAMP_MARGIN_S]


def _bridge(time: np.ndarray, column: np.ndarray, largest_gap: float) -> None:
    """Fills short holes of a column (n,) in place."""
    sound, holes = np.flatnonzero(np.isfinite(column)), np.flatnonzero(~np.isfinite(column))
    behind = np.searchsorted(sound, holes)
    inside = (behind > 0) & (behind < len(sound))
    holes, behind = holes[inside], behind[inside]
    bridged = holes[time[sound[behind]] - time[sound[behind - 1]] <= largest_gap + STAMP_MARGIN_S]
    if len(bridged):
        column[bridged] = np.interp(time[bridged], time[sound], column[sound])


def _inside_gap(signal: Signal, time: np.ndarray, largest_gap: float) -> np.ndarray:
    """(n,) whether the times lie between two samples that are too far apart."""
    after = np.searchsorted(signal.time, time).clip(1, len(signal.time) - 1)
    before_time, after_time = signal.time[after - 1], signal.time[after]
    between = (before_time + STAMP_MARGIN_S < time) & (time < after_time - STAMP_MARGIN_S)
    return between & (after_time - before_time > largest_gap)


def _runs(covered: np.ndarray) -> np.ndarray:
    """(n,) number of the run of covered samples, -1 outside and in runs that are too short."""
    edges = np.flatnonzero(np.diff(covered, prepend=False, append=False))
    run = np.full(len(covered), -1)
    count = 0
    for begin, end in edges.reshape(-1, 2):
        if end - begin >= SHORTEST_RUN:
            run[begin:end] = count
            count += 1
    return run


Method = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]
"""From times (k,) and values (k,) of a column, times (n,), and the longest gap [s] to (n,)."""


def _by_column(method: Method, signal: Signal, time: np.ndarray, largest_gap: float) -> np.ndarray:
    """The signal at each time (n,), from what is not NaN of each column."""
    longest = largest_gap
    if len(signal.time) > 1:
        longest = max(largest_gap, 2.0 * float(np.median(np.diff(signal.time))))
    out = np.full((len(time), *signal.value.shape[1:]), np.nan)
    columns = signal.value.reshape(len(signal.value), -1).T
    for j, (into, values) in enumerate(zip(out.reshape(len(time), -1).T, columns, strict=True)):
        known = np.isfinite(values)
        if known.any():
            into[:] = method(signal.seen(j)[known], values[known], time, longest)
    return out


def _last_seen(signal: Signal) -> float:
    """The last time at which every column is known [s]."""
    return float(signal.time[-1] - (0.0 if signal.latency is None else signal.latency.max()))


def _interpolated(
    logged: np.ndarray, values: np.ndarray, time: np.ndarray, longest: float
) -> np.ndarray:
    after = np.searchsorted(logged, time - STAMP_MARGIN_S).clip(0, len(logged) - 1)
    before = (np.searchsorted(logged, time + STAMP_MARGIN_S, side="right") - 1).clip(0)
    known = (logged[before] <= time + STAMP_MARGIN_S) & (time - STAMP_MARGIN_S <= logged[after])
    known &= logged[after] - logged[before] <= longest + STAMP_MARGIN_S
    return np.where(known, np.interp(time, logged, values), np.nan)


def _held(logged: np.ndarray, values: np.ndarray, time: np.ndarray, longest: float) -> np.ndarray:
    last = np.searchsorted(logged, time + STAMP_MARGIN_S, side="right") - 1
    known = (last >= 0) & (time - logged[last.clip(0)] <= longest + STAMP_MARGIN_S)
    return np.where(known, values[last.clip(0)], np.nan)
