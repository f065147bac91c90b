"""Which route to velocity and acceleration is taken for which kind of data.

One whole period, averaged: the Fourier fit. A record that is not periodic: the Kalman smoother. On
the simulated crane, whose true motion is known, each is the best of the three routes for its kind
(tests/benchmarks/test_signal_routes.py prints the scores).
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from crane_identification.signals.decimate import KEPT_SHARE
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator, SmoothedMotion, checked
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

FREQUENCIES = 4096
"""Points of the frequency response over which the noise of the velocity is summed."""
SHORTEST_PERIOD = 20
FALL_ORDERS = range(5, 13)
"""b; an acceleration of finite power needs 5, one with steps, as of dry friction, has 6."""
TRIED_BANDWIDTHS = 60  # values of K
HIGHEST_FOURIER_BANDWIDTH = 0.25  # of the sampling rate: above, nothing is damped
PROPER_POWER_SHARE = 0.99
"""Share of the power of the velocity that counts as the motion proper."""
EVIDENT_NOISE_FACTOR = 20.0
"""Lines this many times the noise are motion: noise alone gets there with probability e⁻²⁰."""
LOWEST_HARMONICS = 20.0
"""K is at least this many times the highest harmonic of the motion proper: the parallel filter,
which keeps a fifth of the bandwidth, then passes all of it."""
# Share of the largest line, squared, below which noise is that of the arithmetic
LINE_ROUNDING = 1e-30


@dataclass(frozen=True)
class ButterworthDifferentiator:
    """Low-pass at `cutoff` [Hz], forwards and backwards, then central differences twice.

    Source: Janot, Gautier, Brunot (2019), data set EMPS: order 4, and one-sided differences at
    the two ends.
    """

    cutoff: float
    order: int = 4

    def estimate(
        self, position: np.ndarray, step: float, resolution: np.ndarray, progress: Progress = silent
    ) -> SmoothedMotion:
        """Motion at the times of `position` (n, j); `DataError` if it is too short for the filter.

        The noise is that of an encoder that rounds to `resolution` (j,).
        """
        padding = 3 * self.order
        position = checked(position, step, padding + 2)
        if not 0 < self.cutoff < 0.5 / step:
            raise DataError(
                f"Butterworth cut-off {self.cutoff} Hz must lie between 0 and half the sampling "
                f"rate, {0.5 / step:.6g} Hz; choose a lower one"
            )
        sections = signal.butter(self.order, self.cutoff, fs=1 / step, output="sos")
        smooth = signal.sosfiltfilt(sections, position, axis=0, padlen=padding)
        velocity = np.gradient(smooth, step, axis=0)
        acceleration = np.gradient(velocity, step, axis=0)
        progress("motion", 1.0)
        joints = position.shape[1]
        reading_noise = np.asarray(resolution, dtype=float) / np.sqrt(12)
        return SmoothedMotion(
            smooth,
            velocity,
            acceleration,
            np.full(joints, self.cutoff),
            reading_noise,
            reading_noise * _velocity_gain(sections, step),
        )


def _velocity_gain(sections: np.ndarray, step: float) -> float:
    """Standard deviation of the velocity per unit standard deviation of white position noise."""
    angle, response = signal.sosfreqz(sections, worN=FREQUENCIES)
    gain = np.abs(response) ** 2 * np.sin(angle) / step  # twice the filter, one difference
    return float(np.sqrt(np.mean(gain**2)))


# Least-squares Fourier series of one whole period, differentiated exactly.
#
# On samples of a whole period the harmonics are orthogonal: the fit of each is a line of the
# discrete Fourier transform. Above the motion proper the power of the lines falls as (K/k)ᵇ until
# white noise takes over: K is where both are equal, and the best linear estimate of each line, for
# the velocity as for the acceleration, is its share w = 1/(1 + (k/K)ᵇ) (Wiener). K, b and the noise
# are the most likely ones for the power of the lines (Whittle 1953), where all lines count alike.
# The expected error of the acceleration, as a criterion for K, weighs them with k⁴: the noise of
# rounding is not quite white, and a few lines far up where there is more of it would pass for
# motion.


@dataclass(frozen=True)
class FourierFit:
    """Fit of one whole period, each coordinate with the damping that its own lines ask for."""

    def estimate(
        self, position: np.ndarray, step: float, resolution: np.ndarray, progress: Progress = silent
    ) -> SmoothedMotion:
        """Motion at the times of `position` (n, j), one whole period; `DataError` if too short.

        The noise is at least that of encoders that round to `resolution` (j,). What the parallel
        filter keeps of the bandwidth K is not damped at all.
        """
        position = checked(position, step, SHORTEST_PERIOD)
        n = len(position)
        k = np.arange(n // 2 + 1)
        omega = 2 * np.pi * k[:, np.newaxis] / (n * step)
        lines = np.fft.rfft(position, axis=0)
        power = np.abs(lines / n) ** 2
        least = np.asarray(resolution) ** 2 / (12 * n) + LINE_ROUNDING * power.max(axis=0)
        found = [_most_likely(k, *column) for column in zip(power.T, least, strict=True)]
        highest, order, noise = np.array(found).T
        weights = 1.0 / (1.0 + (k[:, np.newaxis] / highest) ** order)
        weights[k[:, np.newaxis] <= KEPT_SHARE * highest] = 1.0
        damped = lines * weights
        progress("motion", 1.0)
        return SmoothedMotion(
            position=np.fft.irfft(damped, n, axis=0),
            velocity=np.fft.irfft(damped * 1j * omega, n, axis=0),
            acceleration=np.fft.irfft(damped * -(omega**2), n, axis=0),
            bandwidth=highest / (n * step),
            position_noise=np.sqrt(n * noise),
            # The expected error of a line, damped away and let through, is w times its noise.
            velocity_noise=np.sqrt(2.0 * (omega**2 * weights * noise).sum(axis=0)),
        )


def _most_likely(k: np.ndarray, power: np.ndarray, least: float) -> tuple[float, int, float]:
    """K, b and the noise, at `least` that, of lines `k` with `power` (both (lines,)).

    Each power is exponentially distributed about noise × (1 + (K/k)ᵇ). Only the lines above those
    of the motion proper count, which are few and follow no law.
    """
    top = 2.0 * HIGHEST_FOURIER_BANDWIDTH * k[-1]
    lowest = min(LOWEST_HARMONICS * _proper(k, power, least), top)
    tried = np.geomspace(lowest, top, TRIED_BANDWIDTHS)
    above = slice(min(int(KEPT_SHARE * lowest) + 1, len(k) // 2), -1)  # the last one is real
    line, seen = k[above].astype(float), power[above, np.newaxis]
    least = max(least, np.finfo(float).tiny)
    found = []
    for order in FALL_ORDERS:
        expected = 1.0 + np.outer(line**-order, tried**order)  # times the noise
        noise = np.maximum((seen / expected).mean(axis=0), least)
        expected *= noise
        surprise = (np.log(expected) + seen / expected).sum(axis=0)
        best = int(surprise.argmin())
        found.append((surprise[best], tried[best], order, noise[best]))
    _, highest, order, noise_there = min(found)
    return float(highest), order, float(noise_there)


def _proper(k: np.ndarray, power: np.ndarray, least: float) -> int:
    """Highest harmonic of the motion proper, at least 1."""
    noise = max(power[len(k) // 2 : -1].mean(), least)
    velocity = np.cumsum(k**2 * power * (power > EVIDENT_NOISE_FACTOR * noise))
    return max(int(np.searchsorted(velocity, PROPER_POWER_SHARE * velocity[-1])), 1)


def estimate_record(
    estimator: MotionEstimator | None,
    position: np.ndarray,
    step: float,
    resolution: np.ndarray,
    progress: Progress = silent,
) -> SmoothedMotion:
    """Motion of a record (n, j) with two ends; `DataError` for an estimator of whole periods."""
    if isinstance(estimator, FourierFit):
        raise DataError(
            "the Fourier fit needs averaged, whole periods; average, or take the Kalman smoother"
        )
    return (estimator or KalmanSmoother()).estimate(position, step, resolution, progress)


def estimate_period(
    estimator: MotionEstimator | None,
    position: np.ndarray,
    step: float,
    resolution: np.ndarray,
    progress: Progress = silent,
) -> SmoothedMotion:
    """Motion over one whole period (n, j), which continues over its ends.

    For estimators that know no periods, half a period is put before and behind, which is far more
    than they remember.
    """
    if estimator is None or isinstance(estimator, FourierFit):
        return (estimator or FourierFit()).estimate(position, step, resolution, progress)
    n = len(position)
    half = n // 2
    extended = np.concatenate([position[n - half :], position, position[:half]])
    motion = estimator.estimate(extended, step, resolution, progress)
    return motion.during(slice(half, half + n))
