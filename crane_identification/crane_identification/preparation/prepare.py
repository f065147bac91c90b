"""From a log to the record that the model is evaluated on: resampled, averaged, smoothed."""

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample, sampling_rate
from crane_identification.options import Options
from crane_identification.preparation.averaging import averaged, whole_periods
from crane_identification.preparation.periodicity import Periodicity, periodic_part
from crane_identification.preparation.run import (
    Preparation,
    along_reference,
    record_of,
    resolution_of,
    signals_of,
    where_moving,
)
from crane_identification.signals.decimate import PADDING, trusted_bandwidth
from crane_identification.signals.routes import estimate_record
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress import Progress, silent


def prepare(
    model: Model,
    log: Log,
    options: Options,
    progress: Progress = silent,
    since: float = 0.0,
    part: Periodicity | None = None,
) -> list[Preparation]:
    """A preparation of each gapless run of `log` (of each that holds a whole period, to average).

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
    return [
        averaged(model, log, samples, rows, length, options, progress, since)
        for rows in long_enough
    ]


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
    if begin + end + PADDING >= len(rows):
        raise DataError(
            f"{log.source}: too little is left of {len(rows)} samples after cutting {begin} at the "
            f"start and {end} at the end, where the motion is not known; record longer, or mend "
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
