"""Zeros of pressure transducers that were lost, in three ways of the other make."""

import numpy as np

from crane_sim.effects.form import Draw, Form, Magnitude
from crane_sim.effects.transducers import OneTransducer


class LastingZero(OneTransducer):
    """A zero that stays where it went."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """The same more at every pressure."""
        (offset,) = self.values
        return pressure + offset


class FadingZero(OneTransducer):
    """An offset that is less the higher the pressure, as of a membrane that was overloaded."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """None at a pressure beyond the range."""
        offset, range_end = self.values
        return pressure + offset * (1.0 - pressure / range_end)


class WanderingZero(OneTransducer):
    """A zero that swings slowly about where it went."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Its mean stays."""
        offset, swing, period = self.values
        return pressure + offset * (1.0 + swing * np.sin(2.0 * np.pi * time / period))


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)

FORMS = (
    Form("pressure_offset", "lasting", LastingZero, _OFFSET, signed=True),
    Form("pressure_offset", "fading", FadingZero, _OFFSET,
         (Draw("range_end", "Pa", 6e7, 2e8),), signed=True),
    Form("pressure_offset", "wandering", WanderingZero, _OFFSET,
         (Draw("swing", "1", 0.02, 0.1), Draw("period", "s", 60.0, 300.0)), signed=True),
)  # fmt: skip
