"""Least-squares Fourier series of one whole period, differentiated exactly.

On samples of a whole period the harmonics are orthogonal: the fit of each is a line of the discrete
Fourier transform. Lines that noise outweighs are damped by w = 1/(1 + (k/K)⁸), the response of a
Butterworth filter of order 4 run forwards and backwards, but without ends and without differences.
K is the one with the least expected error of the acceleration (Stein 1981, unbiased), but far above
the motion proper.
"""

from dataclasses import dataclass

import numpy as np

from crane_identification.progress import Progress, silent
from crane_identification.signals.motion import Motion, checked
from crane_model.errors import DataError

SHORTEST = 20
ORDER = 8  # of the damping
TRIED = 200  # values of K
HIGHEST = 0.25  # of the sampling rate: above, nothing is damped
PROPER = 0.99
"""Share of the power of the velocity that counts as the motion proper."""
LOWEST = 20.0
"""K is at least this many times the highest harmonic of the motion proper: the parallel filter,
which keeps a fifth of the bandwidth, then passes all of it."""
ROUNDING = 1e-30  # share of the largest line, squared, below which noise is that of the arithmetic


@dataclass(frozen=True)
class FourierFit:
    """Fit of one whole period; `harmonics` K, one per coordinate, where they are to be given."""

    harmonics: tuple[float, ...] | None = None

    def estimate(
        self, position: np.ndarray, step: float, resolution: np.ndarray, progress: Progress = silent
    ) -> Motion:
        """Motion at the times of `position` (n, j), one whole period; `DataError` if too short.

        The noise is that of the upper half of the lines, and at least that of encoders that round
        to `resolution` (j,).
        """
        position = checked(position, step, SHORTEST)
        n, joints = position.shape
        if self.harmonics and (len(self.harmonics) != joints or min(self.harmonics) <= 0):
            raise DataError(
                f"harmonics: a positive number for each of {joints} coordinates, got "
                f"{self.harmonics}"
            )
        k = np.arange(n // 2 + 1)
        omega = 2 * np.pi * k / (n * step)
        lines = np.fft.rfft(position, axis=0) / n
        power = np.abs(lines) ** 2
        rounding = np.asarray(resolution) ** 2 / (12 * n) + ROUNDING * power.max(axis=0)
        noise = np.maximum(power[len(k) // 2 : -1].mean(axis=0), rounding)
        highest = np.array(
            self.harmonics or [_highest(k, omega, *x) for x in zip(power.T, noise, strict=True)]
        )
        weights = _weights(k, highest)
        damped = lines * weights
        progress("motion", 1.0)
        return Motion(
            position=np.fft.irfft(damped * n, n, axis=0),
            velocity=np.fft.irfft(damped * n * (1j * omega)[:, np.newaxis], n, axis=0),
            acceleration=np.fft.irfft(damped * n * -(omega**2)[:, np.newaxis], n, axis=0),
            bandwidth=highest / (n * step),
            position_noise=np.sqrt(n * noise),
            # At the best K, what is damped away weighs about as much as the noise let through.
            velocity_noise=np.sqrt(
                4.0 * (omega[:, np.newaxis] ** 2 * weights**2 * noise).sum(axis=0)
            ),
        )


def _weights(k: np.ndarray, highest: np.ndarray) -> np.ndarray:
    """(lines, K) responses of the damping."""
    return 1.0 / (1.0 + (k[:, np.newaxis] / np.atleast_1d(highest)) ** ORDER)


def _highest(k: np.ndarray, omega: np.ndarray, power: np.ndarray, noise: float) -> float:
    """K with the least error of the acceleration, but not below what the motion proper needs.

    The error is the damped part of the signal, which is what its lines hold beyond the noise, and
    the noise let through.
    """
    top = 2.0 * HIGHEST * k[-1]
    tried = np.geomspace(1.0, top, TRIED)
    w = _weights(k, tried)
    error = (1.0 - w) ** 2 * (power - noise)[:, np.newaxis] + w**2 * noise
    best = (omega**4 @ error).argmin()
    velocity = np.cumsum(omega**2 * w[:, best] ** 2 * power)
    proper = int(np.searchsorted(velocity, PROPER * velocity[-1]))
    return float(np.clip(LOWEST * proper, tried[best], top))
