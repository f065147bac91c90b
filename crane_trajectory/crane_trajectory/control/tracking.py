"""How far the crane was from its reference."""

import math
from collections.abc import Mapping

import numpy as np


class PeriodicError:
    """Root mean square of the tracking error over whole periods; a begun period does not count."""

    def __init__(self, joints: int, start: float, period: float, periods: int):
        """Of so many joints (j); the periods begin at the time `start` [s] of the motion."""
        self._start, self._period, self._periods = start, period, periods
        self._current = 0
        self._whole, self._begun = np.zeros((2, joints))
        self._whole_count = self._begun_count = 0

    def add(self, time: float, error: np.ndarray) -> None:
        """The error (j,) at a time [s] of the motion; times rise."""
        index = math.floor((time - self._start) / self._period)
        if index > self._current:
            self._whole += self._begun
            self._whole_count += self._begun_count
            self._begun[:], self._begun_count = 0.0, 0
            self._current = index
        if 0 <= index < self._periods:
            self._begun += error**2
            self._begun_count += 1

    @property
    def rms(self) -> np.ndarray:
        """(j,) [rad, m]; NaN if no period is whole."""
        if not self._whole_count:
            return np.full_like(self._whole, np.nan)
        return np.sqrt(self._whole / self._whole_count)


def beyond(error: np.ndarray, tolerance: np.ndarray, units: Mapping[str, str]) -> str:
    """Names the joints whose error (j,) is beyond the tolerance (j,); empty if there is none.

    `units` of the joints are those of their machine.
    """
    far = np.abs(error) > tolerance
    if not far.any():
        return ""
    return "; ".join(
        f"{joint}: tracking error {error[i]:.4g} {unit} is beyond the tolerance "
        f"{tolerance[i]:.4g} {unit}"
        for i, (joint, unit) in enumerate(units.items())
        if far[i]
    )
