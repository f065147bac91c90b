"""Averaging over periods (37)-(38), and the noise that the scatter between periods reveals."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import t as student

from crane_identification.signals.decimate import UNFILTERED

TRANSIENT = 2.0
"""A first period that differs from the later ones by this many times their scatter is transient."""
LACKING = 3
"""Samples that a period may lack and count as whole."""
LOCAL = 0.04
"""Share of the period over which the scatter is taken as equally large, and a drift is sought."""


@dataclass(frozen=True)
class Averaging:
    """How a recording was averaged.

    `period` [s]; `used` whole periods, the last ones; `transient` whole periods before them were
    left out, and `incomplete` [s] of the periodic part fills no whole period. `drift` of the force.
    """

    period: float
    used: int
    transient: int
    incomplete: float
    drift: "Drift"


@dataclass(frozen=True)
class Drift:
    """Steady change from period to period, per joint (j,); NaN for fewer than three periods.

    `rate`: root mean square change of the force a period [N m or N]. `p_value`: how likely scatter
    that is none would look so.
    """

    rate: np.ndarray
    p_value: np.ndarray


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


def independent_samples(
    deviation: np.ndarray, used: np.ndarray, filtered: np.ndarray = UNFILTERED
) -> np.ndarray:
    """How many of n samples (j,) are independent: tr(C)²/tr(C²) of their covariance C.

    From deviations (M, n, j) from the mean of M periods, over the `used` (n, j) samples: C has
    their variance, which changes over the period, and one autocorrelation, up to the lag at which
    it is lost in its own uncertainty; but at least that which a filter gives to white noise,
    `filtered` (lags,). Where joints turn back the periods differ most, so that a few samples may
    hold most of the power, and the others tell nothing beside them. The chance by which the
    variance, seen in few samples, is uneven too is taken out of C².
    """
    count, samples, joints = deviation.shape
    length = 2 * samples
    window = max(int(LOCAL * samples), 1)
    overlap = np.maximum(1.0 - np.arange(samples) / window, 0.0)
    masked = np.where(used, deviation, 0.0)
    size = np.sqrt(_local_power(masked, used, window))
    scaled = np.divide(
        masked, size, out=np.zeros_like(masked), where=np.broadcast_to(size > 0.0, masked.shape)
    )
    products = np.fft.irfft((np.abs(np.fft.rfft(scaled, length, axis=1)) ** 2).sum(axis=0), axis=0)
    pairs, power = (
        np.fft.irfft(np.abs(np.fft.rfft(values, length, axis=0)) ** 2, axis=0)[:samples]
        for values in (used.astype(float), np.where(used, size**2, 0.0))
    )
    pairs = np.round(pairs)
    out = np.ones(joints)
    for j in range(joints):
        present = pairs[:, j] > 0
        correlation = np.zeros(samples)
        correlation[present] = products[:samples, j][present] / pairs[present, j]
        if not correlation[0] > 0.0:
            continue
        correlation /= correlation[0]
        noise = 2.0 / np.sqrt(np.maximum((count - 1) * pairs[:, j], 1.0))
        lost = np.flatnonzero(np.abs(correlation) < noise)
        last = int(lost[0]) if len(lost) else samples
        alike = correlation**2
        alike[last:] = 0.0
        known = min(len(filtered), samples)
        alike[:known] = np.maximum(alike[:known], filtered[:known] ** 2)
        alike[1:] *= 2.0  # lags to both sides
        # A variance from f degrees of freedom has the relative variance 2/f.
        chance = 2.0 * (overlap @ alike) / window / (count - 1) * overlap
        total = (size[used[:, j], j] ** 2).sum()
        out[j] = total**2 / (power[:, j] / (1.0 + chance) @ alike)
    return out


def _local_power(masked: np.ndarray, used: np.ndarray, window: int) -> np.ndarray:
    """Mean square (n, j) of deviations (M, n, j) in a window around each sample, 0 if none."""
    near = uniform_filter1d((masked**2).mean(axis=0), window, axis=0, mode="wrap")
    share = uniform_filter1d(used.astype(float), window, axis=0, mode="wrap")
    return np.divide(near, share, out=np.zeros_like(near), where=share > 0.5 / window)
