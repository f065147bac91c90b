"""Zero-phase Butterworth filter and central differences: the route of the robotics literature."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from crane_identification.signals.motion import SmoothedMotion, checked
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

FREQUENCIES = 4096
"""Points of the frequency response over which the noise of the velocity is summed."""


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
