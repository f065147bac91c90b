"""What of the controller may be changed while the crane moves, without a jump."""

from dataclasses import dataclass, replace

import numpy as np

from crane_trajectory.control.controller import GainArrays, GainFields

BLEND = 1.0  # s, in which new gains take the place of the old
OF_TOLERANCE = 0.1  # of the tracking tolerance: for joints that the model keeps that much nearer


@dataclass(frozen=True, eq=False)
class Tuning:
    """Gains of (36), largest command (0, 1], tracking tolerance (j,) [rad, m]."""

    gains: GainArrays
    saturation: float
    tolerance: np.ndarray

    def tightened(self, by_model: np.ndarray) -> "Tuning":
        """With the tolerances of joints (j,) that the model leads at `OF_TOLERANCE`."""
        share = np.where(by_model, OF_TOLERANCE, 1.0)
        return replace(self, tolerance=share * self.tolerance)


class Blend:
    """A tuning that follows what it is given: gains and saturation linearly within `BLEND`, so that
    the command does not jump; the tolerance, which moves nothing, at once.
    """

    def __init__(self, tuning: Tuning):
        self._old = self._new = tuning
        self._share = 1.0

    def to(self, tuning: Tuning) -> None:
        """Go to `tuning` from what holds now."""
        self._old, self._new, self._share = self.now, tuning, 0.0

    def advance(self, dt: float) -> Tuning:
        """What holds `dt` [s] later."""
        self._share = min(1.0, self._share + dt / BLEND)
        return self.now

    @property
    def now(self) -> Tuning:
        """What holds now."""
        old, new, share = self._old, self._new, self._share
        if share == 1.0:
            return new
        return Tuning(
            GainFields(
                *((1.0 - share) * a + share * b for a, b in zip(old.gains, new.gains, strict=True))
            ),
            (1.0 - share) * old.saturation + share * new.saturation,
            new.tolerance,
        )
