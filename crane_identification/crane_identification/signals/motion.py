"""From measured positions to positions, velocities and accelerations: the common interface."""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

SAME_READING = 1e-9
"""Readings closer than this share of their range are the same encoder count (float rounding)."""
RESPONSE_ORDER = 6
"""Of the response 1/(1 + (f/bandwidth)⁶): the Kalman smoother's, and that of the Fourier fit where
the acceleration jumps, as dry friction makes it."""


@dataclass(frozen=True)
class SmoothedMotion:
    """Smoothed motion of j coordinates at n uniform times, and how good it is.

    `position`, `velocity`, `acceleration` (n, j) in rad or m, per s, per s²; `bandwidth` (j,) [Hz]
    up to which they follow the truth; `position_noise` (j,) of a single reading and
    `velocity_noise` (j,) of the estimate, both one standard deviation.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    bandwidth: np.ndarray
    position_noise: np.ndarray
    velocity_noise: np.ndarray

    def during(self, kept: slice) -> Self:
        return replace(
            self,
            position=self.position[kept],
            velocity=self.velocity[kept],
            acceleration=self.acceleration[kept],
        )


class MotionEstimator(Protocol):
    """Anything that turns positions (n, j), sampled every `step` s, into a `SmoothedMotion`."""

    def estimate(
        self, position: np.ndarray, step: float, resolution: np.ndarray, progress: Progress = silent
    ) -> SmoothedMotion:
        """Motion at the times of `position`; `resolution` (j,) is that of the encoders."""
        ...


def encoder_resolution(position: np.ndarray) -> np.ndarray:
    """Smallest step between different readings (n, j) of each encoder (j,) [rad or m], NaN aside.

    A coordinate that never moves shows no step and gives 0.
    """
    return np.array([_smallest_step(column) for column in position.T])


def reading_resolution(position: np.ndarray) -> np.ndarray:
    """Resolution (j,) of an encoder that would be as uncertain as the readings (n, j): one step of
    theirs, or √12 standard deviations of their noise, which third differences show."""
    sound = position[np.isfinite(position).all(axis=1)]
    noise = np.diff(sound, 3, axis=0).std(axis=0) / np.sqrt(20)  # 1² + 3² + 3² + 1²
    return np.maximum(encoder_resolution(sound), np.sqrt(12) * noise)


def checked(position: np.ndarray, step: float, shortest: int) -> np.ndarray:
    """`position` as (n, j) floats; `DataError` if it is too short or not finite."""
    position = np.asarray(position, dtype=float)
    if position.ndim != 2 or len(position) < shortest:
        raise DataError(
            f"positions of shape {position.shape}: at least {shortest} samples of each joint are "
            f"needed to estimate velocity and acceleration; record longer"
        )
    if not step > 0:
        raise DataError(f"sampling step {step} s must be positive")
    if not np.isfinite(position).all():
        row, column = np.argwhere(~np.isfinite(position))[0]
        raise DataError(
            f"position of joint {column} at {row * step:.4g} s is {position[row, column]}; "
            f"cut the record to where every encoder was logged"
        )
    return position


def _smallest_step(readings: np.ndarray) -> float:
    readings = readings[np.isfinite(readings)]
    if not len(readings):
        return 0.0
    steps = np.diff(np.unique(readings))
    steps = steps[steps > SAME_READING * np.ptp(readings)]
    return float(steps.min()) if len(steps) else 0.0


# Effect of the estimators of motion on a signal, to filter other signals in the same way.


def smoothed_alike(
    values: np.ndarray, bandwidth: np.ndarray, step: float, periodic: bool
) -> np.ndarray:
    """`values` (n, j), sampled every `step` s, as a motion of that `bandwidth` (j,) [Hz] would be.

    An infinite bandwidth changes nothing. One whole period of values continues over its ends where
    it is `periodic`; otherwise they are mirrored there.
    """
    around = values if periodic else np.concatenate([values, values[::-1]])
    frequency = np.fft.rfftfreq(len(around), step)[:, np.newaxis]
    kept = np.fft.rfft(around, axis=0) / (1.0 + (frequency / bandwidth) ** RESPONSE_ORDER)
    return np.fft.irfft(kept, len(around), axis=0)[: len(values)]
