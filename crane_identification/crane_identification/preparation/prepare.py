"""From a log to the record that the model is evaluated on: resampled, averaged, smoothed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample, sampling_rate
from crane_identification.options import Options
from crane_identification.preparation.averaging import (
    Averaging,
    completed,
    drift,
    fold,
    resolution_of_mean,
    transient_periods,
    whole_periods,
)
from crane_identification.preparation.periodicity import periodic_part
from crane_identification.preparation.run_signals import (
    along_reference,
    coordinates,
    record_of,
    resolution_of,
    signals_of,
)
from crane_identification.preparation.session import Session
from crane_identification.signals.decimate import PADDING
from crane_identification.signals.gate import SETTLING, moving, trusted_bandwidth
from crane_identification.signals.motion import Motion
from crane_identification.signals.routes import estimate_period, estimate_record
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress import Progress, silent
from crane_model.record import Record


@dataclass(frozen=True)
class Preparation:
    """One run of a recording, ready for the regressor.

    `record`: n samples every `step` s with motion and generalized force; one averaged period if
    `averaging` is not None. `moving` (n, j): where the sign of the velocity is known, and
    friction has settled behind a reversal; `signed` (n, j): where the sign is known; of an average
    both hold in each of its periods. `bandwidth` (j,) [Hz] of the motion. `periods` (M, n, j): the
    generalized forces that were averaged. `reference`: the record along the motion that was asked
    for, None where it was not recorded.
    """

    source: str
    record: Record
    step: float
    moving: np.ndarray
    signed: np.ndarray
    bandwidth: np.ndarray
    averaging: Averaging | None
    periods: np.ndarray
    reference: Record | None

    @property
    def periodic(self) -> bool:
        """Whether the record is one whole period, so that it continues over its ends."""
        return self.averaging is not None


def prepare_all(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress = silent,
    session: Session | None = None,
) -> list[Preparation]:
    """`prepare` of each recording, in the time of the `session` (None: of these recordings)."""
    session = session or Session.of(logs)
    out = []
    for number, log in enumerate(logs):

        def partly(phase: str, done: float, number: int = number) -> None:
            progress(phase, (number + done) / len(logs))

        out += prepare(model, log, options, partly, session.since(log))
    return out


def prepare(
    model: Model, log: Log, options: Options, progress: Progress = silent, since: float = 0.0
) -> list[Preparation]:
    """A preparation of each gapless run of `log` (of each that holds a whole period, to average).

    The time of its record counts from a moment `since` [s] before time zero of the log.

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
        part = periodic_part(log, options.period)
    except DataError as error:
        raise DataError(f"{error}; or do not average: --no-average") from None
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
        _averaged(model, log, samples, rows, length, options, progress, since)
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
        options.motion, coordinates(signals), step, resolution_of(log), progress
    )
    bandwidth = motion.bandwidth[: len(model.joints)]
    known = _moving(model, motion, step, False, options)
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
        signed=_moving(model, motion, step, False, options, settling=0.0)[kept],
        bandwidth=bandwidth,
        averaging=None,
        periods=signals["force"][np.newaxis],
        reference=along_reference(record, signals),
    )


def _averaged(
    model: Model,
    log: Log,
    samples: Samples,
    rows: np.ndarray,
    length: int,
    options: Options,
    progress: Progress,
    since: float,
) -> Preparation:
    """The mean over the last whole periods of the run (37)-(38)."""
    signals = signals_of(model, samples, rows)
    step = 1.0 / samples.rate
    whole = whole_periods(len(rows), length)
    signals = {name: completed(values, length, whole) for name, values in signals.items()}
    transient = transient_periods(fold(signals["position"], length, whole))
    used = min(whole - transient, options.periods or whole)
    mean = {name: fold(values, length, used).mean(axis=0) for name, values in signals.items()}
    resolution = resolution_of_mean(fold(coordinates(signals), length, used), resolution_of(log))
    motion = estimate_period(options.motion, coordinates(mean), step, resolution, progress)
    middle = len(signals["position"]) - (used + 1) * length / 2.0  # sample that the mean begins at
    time = since + samples.time[rows[0]] + step * (middle + np.arange(length))
    record = record_of(model, time, mean, motion, options.mask_reversals)
    alike, signed_alike = _moving_alike(model, log, signals, step, length, used, options)
    known = _moving(model, motion, step, True, options) & alike
    periods = fold(signals["force"], length, used)
    remainder = max(len(rows) - whole * length, 0) * step
    return Preparation(
        source=log.source,
        record=record,
        step=step,
        moving=known,
        signed=_moving(model, motion, step, True, options, settling=0.0) & signed_alike,
        bandwidth=motion.bandwidth[: len(model.joints)],
        averaging=Averaging(length * step, used, whole - used, remainder, drift(periods, known)),
        periods=periods,
        reference=along_reference(record, mean),
    )


def _moving_alike(
    model: Model,
    log: Log,
    signals: dict[str, np.ndarray],
    step: float,
    length: int,
    periods: int,
    options: Options,
) -> tuple[np.ndarray, np.ndarray]:
    """(length, j): where each joint moves in all of the last `periods`, and in one direction.

    First where friction has settled in all of them, then where the sign of the velocity is known.
    A joint that comes to rest on its way sets off again at another time in each period: the mean
    force is then none that friction (13) gives at the mean velocity.
    """
    if not options.mask_reversals:
        everywhere = np.ones((length, len(model.joints)), dtype=bool)
        return everywhere, everywhere
    motion = estimate_record(None, signals["position"], step, resolution_of(log))
    settled, signed = (
        np.abs(fold(np.sign(motion.velocity) * known, length, periods).sum(axis=0)) == periods
        for known in (moving(motion, step, False), moving(motion, step, False, settling=0.0))
    )
    return settled, signed


def _moving(
    model: Model,
    motion: Motion,
    step: float,
    periodic: bool,
    options: Options,
    settling: float = SETTLING,
) -> np.ndarray:
    """(n, j): where the sign of the velocity is known, or everywhere if nothing is masked."""
    if not options.mask_reversals:
        return np.ones((len(motion.position), len(model.joints)), dtype=bool)
    return moving(motion, step, periodic, settling)[:, : len(model.joints)]
