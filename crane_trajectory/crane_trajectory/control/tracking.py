"""How far the crane was from its reference."""

import numpy as np

from crane_model.machine import JOINT_UNITS, JOINTS


class PeriodicError:
    """Root mean square of the tracking error over whole periods; a begun period does not count."""

    def __init__(self, start: float, period: float, periods: int):
        """The periods begin at the time `start` [s] of the motion."""
        self._start, self._period, self._periods = start, period, periods
        self._current = 0
        self._whole, self._begun = np.zeros((2, len(JOINTS)))
        self._whole_count = self._begun_count = 0

    def add(self, time: float, error: np.ndarray) -> None:
        """The error (4,) at a time [s] of the motion; times rise."""
        index = int(np.floor((time - self._start) / self._period))
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
        """(4,) [rad, m]; NaN if no period is whole."""
        if not self._whole_count:
            return np.full(len(JOINTS), np.nan)
        return np.sqrt(self._whole / self._whole_count)


def beyond(error: np.ndarray, tolerance: np.ndarray) -> str:
    """Names the joints whose error (4,) is beyond the tolerance (4,); empty if there is none."""
    return "; ".join(
        f"{joint}: tracking error {error[i]:.4g} {JOINT_UNITS[joint]} is beyond the tolerance "
        f"{tolerance[i]:.4g} {JOINT_UNITS[joint]}"
        for i, joint in enumerate(JOINTS)
        if abs(error[i]) > tolerance[i]
    )
