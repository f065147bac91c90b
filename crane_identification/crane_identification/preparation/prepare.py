"""From a log to the record that the model is evaluated on: resampled, averaged, smoothed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Self

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample, sampling_rate
from crane_identification.options import Options
from crane_identification.preparation.periodicity import (
    REPEATING_RMS_SHARE,
    Periodicity,
    periodic_part,
)
from crane_identification.preparation.run import (
    Preparation,
    along_reference,
    averaged,
    record_of,
    resolution_of,
    signals_of,
    where_moving,
    whole_periods,
)
from crane_identification.signals.decimate import FILTER_PADDING, trusted_bandwidth
from crane_identification.signals.routes import estimate_record
from crane_model.errors import DataError, NoMotionError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

TOUCHING = 1.0  # s by which recordings of one session may overlap, as parts of one that was split
COOLED = 4 * 3600.0  # s of a pause after which the machine is cold again: another session


def prepare(
    model: Model,
    log: Log,
    options: Options,
    progress: Progress = silent,
    since: float = 0.0,
    part: Periodicity | None = None,
) -> list[Preparation]:
    """A preparation of each gapless run of `log` (of each that holds a whole period, to average).

    A machine whose force changes from period to period, as late valves make it hunt, is not
    averaged unless the period was given: friction of the mean motion is not the mean friction.

    The time of its record counts from a moment `since` [s] before time zero of the log. `part` is
    what `periodic_part` gives, where that is known already.

    Raises `DataError` if the log lacks joints or forces of the model, or no run is long enough.
    """
    if log.joints != model.joints:
        raise DataError(
            f"{log.source}: holds the joints {', '.join(log.joints)}, but the model has "
            f"{', '.join(model.joints)}; read the recording for the joints of the model"
        )
    if not options.average:
        samples = resample(log)
        return _whole_runs(model, log, samples, options, progress, since)
    try:
        part = part or periodic_part(log, options.period)
    except DataError as error:
        raise type(error)(f"{error}; or do not average: --no-average") from None
    length = round(part.period * sampling_rate(log.position.time))
    samples = resample(log, length / part.period)
    inside = (samples.time >= part.start) & (samples.time <= part.end)
    runs = [np.flatnonzero((samples.run == run) & inside) for run in np.unique(samples.run)]
    long_enough = [rows for rows in runs if whole_periods(len(rows), length)]
    if not long_enough:
        raise DataError(
            f"{log.source}: no whole period of {part.period:.4g} s without a gap; record at least "
            f"two, or do not average: --no-average"
        )
    means = [
        averaged(model, log, samples, rows, length, options, progress, since)
        for rows in long_enough
    ]
    change = max(mean.averaging.change for mean in means if mean.averaging)
    if options.period is not None or change <= REPEATING_RMS_SHARE:
        return means
    whole = _whole_runs(model, log, resample(log), options, progress, since)
    return [replace(run, changing=change) for run in whole]


def _whole_runs(
    model: Model, log: Log, samples: Samples, options: Options, progress: Progress, since: float
) -> list[Preparation]:
    """Those of the runs that something is left of; the error of the first where nothing is."""
    out, errors = [], []
    for run in np.unique(samples.run):
        rows = np.flatnonzero(samples.run == run)
        try:
            out.append(_whole(model, log, samples, rows, options, progress, since))
        except DataError as error:
            errors.append(error)
    if not out:
        raise errors[0]
    return out


def _whole(
    model: Model,
    log: Log,
    samples: Samples,
    rows: np.ndarray,
    options: Options,
    progress: Progress,
    since: float,
) -> Preparation:
    """The run as it is, without the ends that the smoother's memory spoils."""
    signals = signals_of(model, samples, rows)
    step = 1.0 / samples.rate
    motion = estimate_record(
        options.motion, signals["coordinates"], step, resolution_of(log), progress
    )
    bandwidth = motion.bandwidth[: len(model.joints)]
    known = where_moving(model, motion, step, False, options)
    spoilt = int(np.ceil(1.0 / (trusted_bandwidth(bandwidth, known) * step)))
    begin, end = options.trim if options.trim is not None else (spoilt, spoilt)
    if begin + end + FILTER_PADDING >= len(rows):
        raise DataError(
            f"{log.source}: too little is left of {len(rows)} samples after cutting {begin} at the "
            f"start and {end} at the end, where the motion is not known; record longer, or repair "
            "what interrupts the recording"
        )
    kept = slice(begin, len(rows) - end)
    signals = {name: values[kept] for name, values in signals.items()}
    time = since + samples.time[rows][kept]
    record = record_of(model, time, signals, motion.during(kept), options.mask_reversals)
    return Preparation(
        source=log.source,
        record=record,
        step=step,
        moving=known[kept],
        signed=where_moving(model, motion, step, False, options, settling=0.0)[kept],
        bandwidth=bandwidth,
        averaging=None,
        periods=signals["force"][np.newaxis],
        reference=along_reference(record, signals),
    )


# Recordings prepared in the time of their session: oil that warms up does so in pauses as well.


@dataclass(frozen=True)
class Session:
    """Sessions of recordings, in which time and the temperature of the oil go on.

    Parameters
    ----------
    start : dict of str to int
        Start of the session of each recording by its source, on the recordings' clock [ns].
    fallback : str or None
        Why the stamps are not a common clock, so that each recording is a session of its own.
    """

    start: dict[str, int]
    fallback: str | None

    @classmethod
    def of(cls, logs: Sequence[Log]) -> Self:
        """The sessions that recordings belong to, in whatever order they are given."""
        ordered = chronological(logs)
        begins = {log.source: log.start for log in ordered}
        for before, after in pairwise(ordered):
            pause = (after.start - before.start) / NANOSECONDS - _length(before)
            if pause < -TOUCHING:
                return cls(
                    dict(begins),
                    f"the stamps of {before.source} and {after.source} overlap, so time counts "
                    "from the start of each recording",
                )
            if pause < COOLED:
                begins[after.source] = begins[before.source]
        return cls(begins, None)

    def since(self, log: Log) -> float:
        """From the start of its session to time zero of a recording [s]."""
        return (log.start - self.start[log.source]) / NANOSECONDS


def prepare_all(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress = silent,
    session: Session | None = None,
) -> list[Preparation]:
    """`prepare` of each recording, in the time of the `session` (None: of these recordings).

    Raises `DataError` without recordings, and as `prepare`.
    """
    return list(chain.from_iterable(_of_each(prepare, model, logs, options, progress, session)))


def prepare_moving(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress = silent,
    session: Session | None = None,
) -> tuple[list[Preparation], tuple[str, ...]]:
    """As `prepare_all`, without recordings in which no joint of the model moves, and the names of
    these. One in which only a joint outside the model moves tells of its valve all the same.

    Raises `NoMotionError` where none moves in any.
    """
    found = _of_each(_in_motion, model, logs, options, progress, session)
    moving = list(chain.from_iterable(found))
    standing = [log.source for log, prepared in zip(logs, found, strict=True) if not prepared]
    if not moving:
        raise NoMotionError(
            f"{', '.join(standing)}: no joint of model '{model.name}' moves fast enough to "
            "distinguish it from standstill; record a motion"
        )
    return moving, tuple(standing)


def _in_motion(
    model: Model, log: Log, options: Options, progress: Progress, since: float
) -> list[Preparation]:
    """`prepare`, without runs in which no joint moves."""
    try:
        return [each for each in prepare(model, log, options, progress, since) if each.moving.any()]
    except NoMotionError:
        return []


def _of_each(
    prepared: Callable[[Model, Log, Options, Progress, float], list[Preparation]],
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress,
    session: Session | None,
) -> list[list[Preparation]]:
    if not logs:
        raise DataError(f"model '{model.name}': no recordings given; give at least one")
    session = session or Session.of(logs)

    def of(number: int) -> list[Preparation]:
        def partly(phase: str, done: float) -> None:
            progress(phase, (number + done) / len(logs))

        return prepared(model, logs[number], options, partly, session.since(logs[number]))

    return [of(number) for number in range(len(logs))]


def chronological(logs: Sequence[Log]) -> list[Log]:
    """By their first stamps, and where these are equal by name: the order given tells nothing."""
    return sorted(logs, key=lambda log: (log.start, log.source))


def _length(log: Log) -> float:
    """From time zero to the last position [s]."""
    return float(log.position.time[-1])
