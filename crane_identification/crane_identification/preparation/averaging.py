"""Averaging over periods (37)-(38), and the noise that the scatter between periods reveals."""

import numpy as np
from scipy.stats import t as student

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples
from crane_identification.options import Options
from crane_identification.preparation.run import (
    Averaging,
    Drift,
    Preparation,
    along_reference,
    record_of,
    resolution_of,
    signals_of,
    where_moving,
)
from crane_identification.signals.gate import moving
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.routes import estimate_period
from crane_model.model_file import Model
from crane_model.progress_bar import Progress

TRANSIENT = 2.0
"""A first period that differs from the later ones by this many times their scatter is transient."""
LACKING = 3
"""Samples that a period may lack and count as whole."""
LOCAL = 0.04
"""Share of the period over which the scatter is taken as equally large, and a drift is sought."""


def averaged(
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
    encoder = resolution_of(log)
    step = 1.0 / samples.rate
    whole = whole_periods(len(rows), length)
    signals = {name: completed(values, length, whole) for name, values in signals.items()}
    transient = transient_periods(fold(signals["position"], length, whole))
    used = min(whole - transient, options.periods or whole)
    mean = {name: fold(values, length, used).mean(axis=0) for name, values in signals.items()}
    resolution = resolution_of_mean(fold(signals["coordinates"], length, used), encoder)
    motion = estimate_period(options.motion, mean["coordinates"], step, resolution, progress)
    middle = len(signals["position"]) - (used + 1) * length / 2.0  # sample that the mean begins at
    time = since + samples.time[rows[0]] + step * (middle + np.arange(length))
    alike, signed_alike = _moving_alike(model, encoder, signals, step, length, used, options)
    known = where_moving(model, motion, step, True, options) & alike
    periods = fold(signals["force"], length, used)
    record = record_of(model, time, mean, motion, options.mask_reversals)
    remainder = max(len(rows) - whole * length, 0) * step
    return Preparation(
        source=log.source,
        record=record,
        step=step,
        moving=known,
        signed=where_moving(model, motion, step, True, options, settling=0.0) & signed_alike,
        bandwidth=motion.bandwidth[: len(model.joints)],
        reference=along_reference(record, mean),
        averaging=Averaging(length * step, used, whole - used, remainder, drift(periods, known)),
        periods=periods,
    )


def _moving_alike(
    model: Model,
    resolution: np.ndarray,
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
    motion = KalmanSmoother().estimate(signals["position"], step, resolution)
    settled, signed = (
        np.abs(fold(np.sign(motion.velocity) * known, length, periods).sum(axis=0)) == periods
        for known in (moving(motion, step, False), moving(motion, step, False, settling=0.0))
    )
    return settled, signed


def whole_periods(samples: int, length: int) -> int:
    """How many whole periods of `length` samples there are in `samples`.

    N samples span N - 1 steps, and streams do not begin and end together: of several periods the
    last may lack `LACKING` samples.
    """
    nearly = (samples + LACKING) // length
    return nearly if nearly > 1 else samples // length


def completed(values: np.ndarray, length: int, periods: int) -> np.ndarray:
    """`values` (n, ...), and what they lack of whole periods, as it was one period before."""
    lacking = max(periods * length - len(values), 0)
    begin = len(values) - length
    return np.concatenate([values, values[begin : begin + lacking]])


def fold(values: np.ndarray, length: int, periods: int) -> np.ndarray:
    """The last `periods` whole periods of `values` (n, ...): (periods, length, ...)."""
    last = values[len(values) - periods * length :]
    return last.reshape(periods, length, *values.shape[1:])


def transient_periods(position: np.ndarray) -> int:
    """How many of the first of M periods (M, n, j) belong to the transient.

    A period is compared with the mean of those behind it, while these are at least two.
    """
    first = 0
    while len(position) - first >= 3:
        later = position[first + 1 :]
        scatter = np.sqrt((later.var(axis=0, ddof=1)).mean(axis=0))
        expected = scatter * np.sqrt(1 + 1 / len(later))
        deviation = np.sqrt(((position[first] - later.mean(axis=0)) ** 2).mean(axis=0))
        if not (deviation > TRANSIENT * expected).any():
            break
        first += 1
    return first


def noise_of_mean(periods: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Root mean square noise (j,) left in the average of M periods (M, n, j), without any model.

    Over the `used` (n, j) samples; NaN for a single period, which has no scatter.
    """
    count = len(periods)
    if count < 2:
        return np.full(periods.shape[2], np.nan)
    variance = np.where(used, periods.var(axis=0, ddof=1), 0.0).sum(axis=0)
    return np.sqrt(variance / np.maximum(used.sum(axis=0), 1) / count)


def resolution_of_mean(periods: np.ndarray, resolution: np.ndarray) -> np.ndarray:
    """Resolution (j,) that an encoder would need to round like the mean of M periods (M, n, j).

    Periods that differ by more than the `resolution` (j,) of the readings round independently, and
    averaging halves the error of rounding with every fourfold number; equal ones round alike.
    """
    rounding = resolution**2 / 12
    if len(periods) < 2:
        return resolution
    own = np.minimum(periods.var(axis=0, ddof=1).mean(axis=0), rounding)
    return np.sqrt(12 * (rounding - own + own / len(periods)))


def drift(periods: np.ndarray, used: np.ndarray) -> Drift:
    """The steady change in M periods (M, n, j) and whether their scatter explains it.

    Over the `used` (n, j) samples. Of the power of the scatter the contrast along the number of the
    period has one part in M - 1 if there is no drift, whatever the noise and its correlation. This
    share is taken in each of many stretches of the period, so that all count alike: a drift shows
    in most of them, a joint that vibrates, or sets off late in one of the periods, in a few. As
    these lie side by side, neighbouring stretches count as less than two where they are alike.
    """
    count, samples, joints = periods.shape
    if count < 3:
        return Drift(np.full(joints, np.nan), np.full(joints, np.nan))
    number = np.arange(count) - (count - 1) / 2
    length = np.linalg.norm(number)
    deviation = np.where(used, periods - periods.mean(axis=0), 0.0)
    contrast = np.tensordot(number / length, deviation, axes=1)  # (n, j)
    starts = np.arange(0, samples, max(int(LOCAL * samples), 1))
    steady, whole = (
        np.add.reduceat(power, starts) for power in (contrast**2, (deviation**2).sum(axis=0))
    )  # (stretches, j)
    expected = 1.0 / (count - 1)
    p_value = np.full(joints, np.nan)
    for j in range(joints):
        seen = whole[:, j] > 0.0
        if seen.sum() > 2:
            p_value[j] = _p_value(steady[seen, j] / whole[seen, j], expected)
    # Without what the scatter adds to it.
    change = np.maximum(steady.sum(axis=0) - expected * whole.sum(axis=0), 0.0) / (1.0 - expected)
    return Drift(np.sqrt(change / np.maximum(used.sum(axis=0), 1)) / length, p_value)


def _p_value(share: np.ndarray, expected: float) -> float:
    """How likely neighbours (n,) that are alike have a mean so far above the expected one."""
    above = share.mean() - expected
    deviation = share - share.mean()
    power = (deviation**2).sum()
    if not power > 0.0:
        return 0.0 if above > 0.0 else 1.0
    alike = max(float((deviation[1:] * deviation[:-1]).sum() / power), 0.0)
    independent = max(len(share) * (1.0 - alike) / (1.0 + alike), 2.0)
    error = np.sqrt(power / (len(share) - 1) / independent)
    return float(student.sf(above / error, independent - 1.0))
